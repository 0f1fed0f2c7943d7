// What an update of a flight's corrections computes, see floatplan/inflight/update.py: the expected state, the filter
// of orientation, momentum and masses, and the rest of the flight written anew and corrected.

class FlightUpdate {
  public:
    explicit FlightUpdate(Flight &flight)
        : f(flight), n(f.joints), g(f.groups), m(f.bodies), columns(6 + f.width), state_size(2 + 2 * f.bodies) {}

    // Takes in a motion from `begin` to `end`, s; the oldest is forgotten.
    void remember(double begin, double end, const double *coefficients) {
        f.newest = (f.newest + 1) % f.memory;
        if (f.known < f.memory) ++f.known;
        double *motion = f.motions + f.newest * motion_size();
        motion[0] = begin, motion[1] = end;
        double scale = 1;
        for (std::int64_t order = 0; order < 3; ++order, scale /= end - begin)
            for (std::int64_t r = 0; r < columns; ++r)
                for (std::int64_t i = 0; i < n; ++i) {
                    double part = 0;
                    for (std::int64_t c = 0; c < columns; ++c)
                        part += f.table[(order * columns + r) * columns + c] * coefficients[c * n + i];
                    motion[2 + (order * columns + r) * n + i] = scale * part;
                }
    }

    // Joints and base at the time of a measurement, if they were on their reference, and how well the orientation is known.
    void expect() {
        const std::int64_t nodes = f.gap_nodes;
        for (std::int64_t k = 0; k < nodes; ++k) {
            look(k, f.began + (f.measured - f.began) * f.gap[k]);
            look(nodes + 1 + k, f.measured + (f.now - f.measured) * f.gap[k]);
        }
        look(nodes, f.measured);
        f.turn_before = turned(0, f.measured - f.began);
        inertia_at(nodes, f.map);
        double rate = f.state[1], aside = 0;
        for (std::int64_t i = 0; i < n; ++i) {
            f.positions[i] = positions(nodes)[i];
            f.velocities[i] = speeds(nodes)[i];
            rate -= f.map[1 + i] * f.velocities[i];
            aside -= f.map[1 + i] * (f.measured_positions[i] - f.positions[i]);
        }
        f.expected_rate = rate / f.map[0];
        f.aside = aside / f.map[0];
        double *row = f.filter_memory;
        momentum_row(f.expected_rate, f.positions, f.velocities, row);
        const double per_row = (f.measured - f.began) / f.map[0];
        f.noise = 0;
        for (std::int64_t i = 0; i <= n; ++i) f.noise += f.map[i] * f.map[i] / (f.map[0] * f.map[0]);
        f.variance = f.covariance[0];
        for (std::int64_t e = 0; e < state_size; ++e) {
            double part = 2 * f.covariance[e];
            for (std::int64_t o = 0; o < state_size; ++o) part += f.covariance[e * state_size + o] * row[o] * per_row;
            f.variance += per_row * row[e] * part;
        }
    }

    // The filter, see floatplan/inflight/estimate.py; right after expect(), whose row it takes.
    void learn() {
        const double dt = f.measured - f.began;
        f.state[0] += f.turn_before;
        double *row = f.filter_memory, *other = row + state_size, *gain = other + state_size;
        momentum_row(f.measured_rate, f.measured_positions, f.measured_velocities, other);
        double momentum = 0;
        for (std::int64_t e = 2; e < state_size; ++e) momentum -= other[e];
        predict(row, dt / f.map[0], dt, gain);
        for (std::int64_t e = 0; e < state_size; ++e) other[e] = e == 0;
        correct(other, f.measured_orientation - f.aside - f.state[0], f.angle_variance * f.noise, gain);
        double innovation = momentum, deviation = 0;
        for (std::int64_t e = 0; e < state_size; ++e) {
            innovation -= row[e] * f.state[e];
            double part = 0;
            for (std::int64_t o = 0; o < state_size; ++o) part += f.covariance[e * state_size + o] * row[o];
            deviation += row[e] * part;
        }
        const double variance = f.rate_variance * f.noise * f.map[0] * f.map[0];
        if (believed(innovation, std::sqrt(deviation + variance))) correct(row, innovation, variance, gain);
        for (std::int64_t e = 2; e < state_size; ++e)
            f.state[e] = smaller(larger(f.state[e], -f.largest_error), f.largest_error);
        adapt();
        f.turn_after = turned(f.gap_nodes + 1, f.now - f.measured);
    }

    // C of the masses found.
    void adapt() {
        const double *masses = f.state + 2, *inertias = masses + m;
        for (std::int64_t b = 0; b < m; ++b)
            for (std::int64_t o = 0; o < g; ++o) {
                double x = 0, y = 0;
                for (std::int64_t e = 0; e < m; ++e) {
                    double part = masses[e] * f.mass[e], re = f.own_real[e * m + b], im = -f.own_imaginary[e * m + b];
                    double group_re = f.weights_real[e * g + o], group_im = f.weights_imaginary[e * g + o];
                    x += part * (re * group_re - im * group_im);
                    y += part * (re * group_im + im * group_re);
                }
                f.rows_real[b * g + o] = f.nominal_real[b * g + o] + x;
                f.rows_imaginary[b * g + o] = f.nominal_imaginary[b * g + o] + y;
            }
        for (std::int64_t e = 0; e < g * g; ++e) f.merged_real[e] = f.merged_imaginary[e] = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            const std::int64_t own = f.group[b];
            f.inertia[b] = f.nominal_inertia[b] * (1 + inertias[b]);
            for (std::int64_t o = 0; o < g; ++o) {
                f.merged_real[own * g + o] += f.rows_real[b * g + o];
                f.merged_imaginary[own * g + o] += f.rows_imaginary[b * g + o];
            }
            f.merged_real[own * g + own] += f.inertia[b];
        }
    }

    // The present motion from now to the landing, written anew.
    void rewrite() {
        double *values = f.filter_memory;  // (columns + 1, n)
        const double left = f.landing - f.now;
        const double *motion = motion_at(f.now);
        for (std::int64_t r = 0; r < columns; ++r)
            argument(motion, f.now + f.points[r] * (motion[1] - f.now), 0, values + r * n);
        for (std::int64_t r = 0; r < columns; ++r)
            for (std::int64_t i = 0; i < n; ++i) {
                double part = 0;
                for (std::int64_t c = 0; c < columns; ++c) part += f.of_values[r * columns + c] * values[c * n + i];
                f.coefficients[r * n + i] = part;
            }
        double scale = 1;
        for (std::int64_t order = 0; order < 3; ++order, scale *= left) {
            argument(motion, f.now, order, f.coefficients + order * n);
            for (std::int64_t i = 0; i < n; ++i) {
                f.coefficients[order * n + i] *= scale;
                f.coefficients[(3 + order) * n + i] = scale * f.at_landing[order * n + i];
            }
        }
    }

    void correct() {
        rewrite();
        RestOfFlight rest(f);
        rest.T = f.landing - f.now;
        rest.h = f.state[1];
        rest.orientation = f.state[0] + f.turn_after;
        rest.change = f.goal - rest.orientation;
        Ahead two[2];
        double *memory = f.ahead_memory;
        for (Ahead &a : two) lay_out(a, memory);
        Correcting law(f, rest, two);
        law.correct(f.coefficients, f.evaluations, f.corrected);
        remember(f.now, f.landing, f.coefficients);
    }

  private:
    Flight &f;
    const std::int64_t n, g, m, columns, state_size;

    std::int64_t motion_size() const { return 2 + 3 * columns * n; }

    void lay_out(Ahead &a, double *&memory) const {
        const std::int64_t K = f.instants;
        auto take = [&](double *&array, std::int64_t count) {
            array = memory;
            memory += (count + 7) / 8 * 8;
        };
        take(a.coefficients, columns * n);
        for (double **each : {&a.sine, &a.cosine, &a.p_rate, &a.p_curvature, &a.speed, &a.acceleration, &a.by_position,
                              &a.by_speed})
            take(*each, n * K);
        for (double **each : {&a.c, &a.s, &a.swing, &a.inertia, &a.turned, &a.relative, &a.x, &a.y}) take(*each, g * K);
        for (double **each : {&a.moment, &a.locked_part}) take(*each, m * K);
        for (double **each : {&a.rate, &a.inverse, &a.base_acceleration}) take(*each, K);
        for (double **each : {&a.value, &a.violation}) take(*each, f.block_first[f.blocks] * K);
        take(a.worst, f.blocks);
        if (!f.capsules) return;
        for (double **each : {&a.angle, &a.turn_c, &a.turn_s}) take(*each, K);
        for (double **each : {&a.end_x, &a.end_y}) take(*each, 2 * f.capsules * K);
    }

    const double *motion_at(double time) const {
        for (std::int64_t back = 0; back < f.known; ++back) {
            const double *motion = f.motions + ((f.newest + f.memory - back) % f.memory) * motion_size();
            if (back == f.known - 1 || time >= motion[0]) return motion;
        }
        return f.motions;
    }

    // p (n), or a derivative of it by time; at the nearer end outside of the motion's time.
    void argument(const double *motion, double time, std::int64_t order, double *p) const {
        double u = smaller(larger((time - motion[0]) / (motion[1] - motion[0]), 0), 1), x = 2 * u - 1;
        const double *polynomials = motion + 2 + order * columns * n;
        double before = 1, polynomial = x;
        for (std::int64_t i = 0; i < n; ++i) p[i] = polynomials[i];
        for (std::int64_t r = 1; r < columns; ++r) {
            for (std::int64_t i = 0; i < n; ++i) p[i] += polynomial * polynomials[r * n + i];
            double next = 2 * x * polynomial - before;
            before = polynomial;
            polynomial = next;
        }
    }

    double *positions(std::int64_t k) const { return f.gap_memory + k * (2 * n + 3 * g); }
    double *speeds(std::int64_t k) const { return positions(k) + n; }
    double *cosines(std::int64_t k) const { return positions(k) + 2 * n; }  // then sines and rates, of groups

    void look(std::int64_t k, double time) const {
        const double *motion = motion_at(time);
        double *q = positions(k), *v = speeds(k);
        argument(motion, time, 0, q);
        argument(motion, time, 1, v);
        bool outside = time > motion[1] || time < motion[0];
        for (std::int64_t i = 0; i < n; ++i) {
            v[i] = outside ? 0 : f.amplitude[i] * std::cos(q[i]) * v[i];
            q[i] = f.centre[i] + f.amplitude[i] * std::sin(q[i]);
        }
        turn_groups(q, v, cosines(k));
    }

    void turn_groups(const double *q, const double *v, double *of) const {
        for (std::int64_t b = 0; b < g; ++b) {
            double angle = 0, rate = 0;
            for (std::int64_t i = 0; i < n; ++i) {
                angle += f.turns[b * n + i] * q[i];
                rate += f.turns[b * n + i] * v[i];
            }
            of[b] = std::cos(angle);
            of[g + b] = f.turn * std::sin(angle);
            of[2 * g + b] = rate;
        }
    }

    // Re conj(E) C E of a group, C of the masses found.
    double group_inertia(const double *of, std::int64_t b) const {
        double x = 0, y = 0;
        for (std::int64_t o = 0; o < g; ++o) {
            double re = f.merged_real[b * g + o], im = f.merged_imaginary[b * g + o];
            x += re * of[o] - im * of[g + o];
            y += re * of[g + o] + im * of[o];
        }
        return of[b] * x + of[g + b] * y;
    }

    // D (n+1) at a node.
    void inertia_at(std::int64_t k, double *map) const {
        for (std::int64_t i = 0; i <= n; ++i) map[i] = 0;
        for (std::int64_t b = 0; b < g; ++b) {
            double inertia = group_inertia(cosines(k), b);
            map[0] += inertia;
            for (std::int64_t i = 0; i < n; ++i) map[1 + i] += f.turns[b * n + i] * inertia;
        }
    }

    // By how much the base turns in `dt` s, from the nodes `from` on.
    double turned(std::int64_t from, double dt) const {
        if (dt == 0) return 0;
        double total = 0;
        for (std::int64_t k = 0; k < f.gap_nodes; ++k) {
            const double *of = cosines(from + k);
            double locked = 0, moving = 0;
            for (std::int64_t b = 0; b < g; ++b) {
                double inertia = group_inertia(of, b);
                locked += inertia;
                moving += inertia * of[2 * g + b];
            }
            total += f.gap_weights[k] * (f.state[1] - moving) / locked;
        }
        return dt * total;
    }

    // How h less the momentum with the plan's masses depends on the state.
    void momentum_row(double rate, const double *q, const double *v, double *row) const {
        double *of = f.filter_memory + 3 * state_size;
        turn_groups(q, v, of);
        row[0] = 0;
        row[1] = 1;
        for (std::int64_t e = 0; e < m; ++e) {
            double x = 0, y = 0, moving_x = 0, moving_y = 0;
            for (std::int64_t o = 0; o < g; ++o) {
                double re = f.weights_real[e * g + o], im = f.weights_imaginary[e * g + o];
                double part_x = re * of[o] - im * of[g + o], part_y = re * of[g + o] + im * of[o];
                x += part_x;
                y += part_y;
                moving_x += part_x * (of[2 * g + o] + rate);
                moving_y += part_y * (of[2 * g + o] + rate);
            }
            row[2 + e] = -f.mass[e] * (x * moving_x + y * moving_y);
            row[2 + m + e] = -f.nominal_inertia[e] * (of[2 * g + f.group[e]] + rate);
        }
    }

    void predict(const double *row, double per_row, double dt, double *change) {
        double *covariance = f.covariance, again = 0;
        for (std::int64_t e = 0; e < state_size; ++e) covariance[e * state_size + e] += dt * f.wander[e];
        for (std::int64_t e = 0; e < state_size; ++e) {
            change[e] = 0;
            for (std::int64_t o = 0; o < state_size; ++o) change[e] += covariance[e * state_size + o] * row[o] * per_row;
        }
        for (std::int64_t e = 0; e < state_size; ++e) {
            covariance[e] += change[e];
            again += row[e] * per_row * change[e];
        }
        for (std::int64_t e = 0; e < state_size; ++e) covariance[e * state_size] += change[e];
        covariance[0] += again;
    }

    void correct(const double *row, double innovation, double variance, double *gain) {
        double total = variance;
        for (std::int64_t e = 0; e < state_size; ++e) {
            gain[e] = 0;
            for (std::int64_t o = 0; o < state_size; ++o) gain[e] += f.covariance[e * state_size + o] * row[o];
            total += row[e] * gain[e];
        }
        for (std::int64_t e = 0; e < state_size; ++e) {
            double along = gain[e] / total;
            f.state[e] += along * innovation;
            for (std::int64_t o = 0; o < state_size; ++o) f.covariance[e * state_size + o] -= along * gain[o];
        }
    }

    bool believed(double innovation, double deviation) {
        std::int64_t &surprises = *f.surprises;
        if (std::fabs(innovation) <= f.surprising * deviation) {
            surprises = 0;
            return true;
        }
        std::int64_t side = innovation > 0 ? 1 : -1;
        surprises = surprises * side > 0 ? surprises + side : side;
        if (surprises * side < f.most_surprises) return false;
        for (std::int64_t e = 0; e < state_size; ++e)
            for (std::int64_t known = 0; known < 2; ++known)
                f.covariance[known * state_size + e] = f.covariance[e * state_size + known] = 0;
        for (std::int64_t known = 0; known < 2; ++known)
            f.covariance[known * state_size + known] = f.deviations[known] * f.deviations[known];
        surprises = 0;
        return true;
    }
};

static inline void update_flight(Flight &flight, std::int64_t what) {
    FlightUpdate update(flight);
    switch (what) {
    case remember_motion: return update.remember(flight.now, flight.landing, flight.coefficients);
    case expect_state: return update.expect();
    case learn_state: return update.learn();
    case adapt_masses: return update.adapt();
    case rewrite_motion: return update.rewrite();
    default: update.correct();
    }
}
