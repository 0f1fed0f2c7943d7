// The remaining flight in a plane, see prediction.hpp; and what is measured of one, see flight.hpp.

class PlanarRemaining {
  public:
    using Body = Robot;
    using Point = Place;
    using State = Motion;
    static constexpr Index equalities = 1;

    bool landed = false;  // see RestOfFlight::land()

    PlanarRemaining(const Robot &robot, const Constraints &constraints, const CorrectedFlight &flight)
        : robot(robot), constraints(constraints), f(flight), n(robot.joints), K(f.instants), size(n * f.width) {}

    static Motion &motion_of(Motion &m) { return m; }
    static const Motion &motion_of(const Motion &m) { return m; }
    Terms terms() const { return terms_of(robot); }
    Index first_placed() const { return f.nodes; }

    void lay_out(Arena &arena, Motion &m) const { lay_out_motion(arena, m, robot, constraints.capsules, K); }

    void lay_out(Arena &arena) {
        arena.take(drift, K * size);
        arena.take(attitude_slopes, 8 * size);
    }

    void begin(double seconds) {
        T = seconds;
        orientation = f.state[0] + f.turn_after[0];
        change = f.goal - orientation;
    }

    void turn_base(Motion &m, double *miss) const {
        compute_base_rate(robot, m, f.state[1]);
        miss[0] = -change;
        for (Index k = 0; k < f.nodes; ++k) miss[0] += T * f.weights[k] * m.rate[k];
    }

    void move_links(Motion &m, const double *miss) const {
        if (constraints.needs_moments) move_bodies(robot, m);
        if (!constraints.needs_places) return;
        for (Index k = f.nodes; k < K; ++k) {
            const double turned = dot(f.integrals + (k - f.nodes) * f.nodes, m.rate, f.nodes);
            m.attitude[k] = orientation + T * turned - landed * miss[0] * f.s[k];
            m.time[k] = f.now + T * f.s[k];
        }
        place(robot, constraints, m, f.now, f.nodes);
    }

    void find_moments(Motion &m) const {
        if (!constraints.needs_moments) move_bodies(robot, m);
    }

    void differentiate_miss(Motion &m, const Variables &variables, double *row) const {
        differentiate_base_rate(robot, m);
        for (Index k = 0; k < f.nodes; k += LANES) chain_rate(variables, m, n, k, drift, K);
        for (Index c = 0; c < size; ++c) row[c] = T * dot(f.weights, drift + c * K, f.nodes);
    }

    void differentiate(Motion &m, const Variables &variables, Index row, Index k, double *pack) const {
        const Index lane = k % 8, first = k / LANES * LANES;
        if (k >= f.nodes && constraints.kind[row] > share_row)
            for (Index c = 0; c < size; ++c) {
                double turned = 0;
                for (Index j = 0; j < f.nodes; ++j)
                    turned += (f.integrals[(k - f.nodes) * f.nodes + j] - landed * f.s[k] * f.weights[j]) *
                              drift[c * K + j];
                attitude_slopes[8 * c + lane] = T * turned;
            }
        differentiate_row(robot, constraints, m, variables, row, first, attitude_slopes + first % 8, 8, pack);
    }

  private:
    const Robot &robot;
    const Constraints &constraints;
    const CorrectedFlight &f;
    const Index n, K, size;
    double T = 0, change = 0, orientation = 0;
    double *drift = nullptr, *attitude_slopes = nullptr;  // (size, K), (size, 8)
};

class PlanarFilter {
  public:
    using Body = Robot;
    using Remaining = PlanarRemaining;
    static constexpr Index equalities = 1;

    const Index joints, masses;

    PlanarFilter(const Robot &robot, CorrectedFlight &flight)
        : joints(robot.joints), masses(robot.links), robot(robot), f(flight), g(robot.bodies), m(robot.links) {}

    void lay_out(Arena &arena, Index instants) {
        lay_out_motion(arena, look, robot, 0, instants);
        arena.take(inertia, g);
    }

    Motion &motion() { return look; }
    const Motion &motion() const { return look; }

    void move() { compute_base_rate(robot, look, f.state[1]); }

    void turn_before(double dt) { f.turn_before[0] = turned(0, dt); }
    void turn_after(Index from, double dt) {
        compute_base_rate(robot, look, f.state[1]);
        f.turn_after[0] = turned(from, dt);
    }

    // D at an instant, the rate of the base there, and what differences of the joints from there make of the orientation.
    void expect(Index here) {
        for (Index b = 0; b < g; ++b) inertia[b] = look.inertia[b * look.stride + here];
        gather(robot, inertia, f.map + 1);
        f.map[0] = inertia[0];
        f.expected_rate[0] = look.rate[here];
        f.aside[0] = 0;
        f.noise[0] = 1;
        for (Index i = 0; i < joints; ++i) {
            const double ratio = f.map[1 + i] / f.map[0];
            f.aside[0] -= ratio * (f.measured_positions[i] - f.positions[i]);
            f.noise[0] += ratio * ratio;
        }
    }

    void turns_by_momentum(double dt, double *per_momentum) const { per_momentum[0] = dt / f.map[0]; }

    double momentum_variance(Index) const {
        return f.options.rate_noise * f.options.rate_noise * f.noise[0] * f.map[0] * f.map[0];
    }

    void momentum_rows(const double *rates, Index k, double *row) const {
        const double rate = rates[0];
        row[0] = 0;
        row[1] = 1;
        for (Index e = 0; e < m; ++e) {
            double x = 0, y = 0, moving_x = 0, moving_y = 0;
            for (Index o = 0; o < g; ++o) {
                const Index at = o * look.stride + k;
                double re = f.weights_real[e * g + o], im = f.weights_imaginary[e * g + o];
                double part_x = re * look.body_cosine[at] - im * look.body_sine[at];
                double part_y = re * look.body_sine[at] + im * look.body_cosine[at];
                x += part_x;
                y += part_y;
                moving_x += part_x * (look.swing[at] + rate);
                moving_y += part_y * (look.swing[at] + rate);
            }
            row[2 + e] = -f.mass[e] * (x * moving_x + y * moving_y);
            row[2 + m + e] = -f.inertia[e] * (look.swing[robot.group[e] * look.stride + k] + rate);
        }
    }

    void go_on() { f.state[0] += f.turn_before[0]; }
    double off(Index) const { return f.measured_orientation[0] - f.aside[0] - f.state[0]; }
    void take_correction() {}

    // C of the masses found, and of the bodies that turn alike.
    void adapt() {
        const double *masses = f.state + 2, *inertias = masses + m;
        copy(f.link_real, f.nominal_real, m * g);
        copy(f.link_imaginary, f.nominal_imaginary, m * g);
        for (Index e = 0; e < m; ++e) {
            add(masses[e], f.by_mass_real + e * m * g, m * g, f.link_real);
            add(masses[e], f.by_mass_imaginary + e * m * g, m * g, f.link_imaginary);
        }
        zero(f.real, g * g);
        zero(f.imaginary, g * g);
        for (Index b = 0; b < m; ++b) {
            const Index own = robot.group[b];
            f.link_real[b * g + own] += f.inertia[b] * inertias[b];
            add(1, f.link_real + b * g, g, f.real + own * g);
            add(1, f.link_imaginary + b * g, g, f.imaginary + own * g);
        }
    }

    // Moments at the first instants, from joints that are placed and accelerate there.
    void find_moments() {
        compute_base_rate(robot, look, f.state[1]);
        move_bodies(robot, look);
    }

  private:
    const Robot &robot;
    CorrectedFlight &f;
    const Index g, m;
    Motion look{};
    double *inertia = nullptr;  // (bodies)

    // By how much the base turns in `dt` s, from the nodes `from` on.
    double turned(Index from, double dt) const {
        if (dt == 0) return 0;
        return dt * dot(f.gap_weights, look.rate + from, f.options.gap_nodes);
    }
};
