// The rest of a flight under a motion of the joints: how the base turns, rows of constraints, and their derivatives.

struct Predicted {
    Motion motion;
    double *coefficients;      // (6 + width, n)
    double *value, *violation; // (rows, K)
    double *worst;             // (blocks)
    double miss, square;       // square: of all violations
};

class RestOfFlight {
  public:
    RestOfFlight(const Robot &robot, const Constraints &constraints, const Flight &flight)
        : has_distances(constraints.needs_places), robot(robot), constraints(constraints), f(flight), n(robot.joints),
          K(f.instants), columns(6 + f.width), size(n * f.width), variables{size, K, f.basis, f.columns, 0, 0} {}

    const bool has_distances;
    double T = 0, h = 0, change = 0, orientation = 0;
    bool landed = false;  // distances are those of a base that turns to the goal: the miss is taken off, by time
    double *drift = nullptr, *attitude_slopes = nullptr, *pack = nullptr;  // (size, K), twice (size, 8)

    void lay_out(Arena &arena, Predicted &a) const {
        lay_out_motion(arena, a.motion, robot, constraints.capsules, K);
        arena.take(a.coefficients, columns * n);
        for (double **each : {&a.value, &a.violation}) arena.take(*each, constraints.rows * K);
        arena.take(a.worst, f.blocks);
    }

    void lay_out(Arena &arena) {
        arena.take(drift, K * size);
        for (double **each : {&attitude_slopes, &pack}) arena.take(*each, 8 * size);
    }

    void evaluate(Predicted &a) const {
        Motion &m = a.motion;
        m.per_second = 1 / T;
        combine(m, n, a.coefficients, columns, f.value, f.first, f.second);
        swing_joints(n, m, f.centre, f.amplitude);
        turn(robot, m, h);
        if (constraints.needs_moments) move_bodies(robot, m);
        a.miss = -change;
        for (Index k = 0; k < f.nodes; ++k) a.miss += T * f.weights[k] * m.rate[k];
        if (constraints.needs_places) place_capsules(a);
        evaluate_rows(a);
    }

    // Largest torque of each motor, N m.
    void find_torque_peaks(Predicted &a) const {
        Motion &m = a.motion;
        if (!constraints.needs_moments) move_bodies(robot, m);
        for (Index motor = 0; motor < f.motors; ++motor) {
            Vector most = all(0);
            for (Index k = 0; k < K; k += LANES)
                most = larger(magnitude(motor_torque(robot, m, f.turns + n + motor, n + f.motors, k)), most);
            f.torque_peak[motor] = largest(most);
        }
    }

    // Derivative (n width) of the miss; that of rows needs it first.
    void differentiate_miss(Predicted &a, double *row) const {
        Motion &m = a.motion;
        differentiate_turn(robot, m);
        for (Index k = 0; k < f.nodes; k += LANES) chain_rate(variables, m, n, k, drift, K);
        for (Index c = 0; c < size; ++c) row[c] = T * dot(f.weights, drift + c * K, f.nodes);
    }

    // Derivative (n width) of a row at an instant.
    void differentiate(Predicted &a, Index row, Index k, double *slopes) const {
        const Index lane = k % 8, first = k / LANES * LANES;
        if (k >= f.nodes && constraints.kind[row] > share_row)
            for (Index c = 0; c < size; ++c) {
                double turned = 0;
                for (Index j = 0; j < f.nodes; ++j)
                    turned += (f.integrals[(k - f.nodes) * f.nodes + j] - landed * f.s[k] * f.weights[j]) *
                              drift[c * K + j];
                attitude_slopes[8 * c + lane] = T * turned;
            }
        differentiate_row(robot, constraints, a.motion, variables, row, first, attitude_slopes + first % 8, 8, pack);
        for (Index c = 0; c < size; ++c) slopes[c] = pack[8 * c + lane];
    }

  private:
    const Robot &robot;
    const Constraints &constraints;
    const Flight &f;
    const Index n, K, columns, size;
    const Variables variables;

    void place_capsules(Predicted &a) const {
        Motion &m = a.motion;
        for (Index k = f.nodes; k < K; ++k) {
            const double turned = dot(f.integrals + (k - f.nodes) * f.nodes, m.rate, f.nodes);
            m.attitude[k] = orientation + T * turned - landed * a.miss * f.s[k];
            m.time[k] = f.now + T * f.s[k];
        }
        place(robot, constraints, m, f.now, f.nodes);
    }

    // Values of all rows, those of distances infinite at the nodes and outside of their windows.
    void evaluate_rows(Predicted &a) const {
        const double *time = a.motion.time;
        a.square = 0;
        for (Index block = 0; block < f.blocks; ++block) {
            a.worst[block] = HUGE_VAL;
            for (Index r = f.block_first[block]; r < f.block_first[block + 1]; ++r) {
                double *value = a.value + r * K, *violation = a.violation + r * K;
                row_values<Place>(terms_of(robot), constraints, a.motion, r, 0, K, value);
                for (Index k = 0; constraints.kind[r] > share_row && k < K; ++k) {
                    const double *window = f.row_window + 2 * r;
                    if (k < f.nodes || !(time[k] >= window[0] && time[k] <= window[1])) value[k] = HUGE_VAL;
                }
                for (Index k = 0; k < K; ++k) {
                    violation[k] = 0;
                    if (value[k] < a.worst[block] || std::isnan(value[k])) a.worst[block] = value[k];
                    if (value[k] >= f.aim[block]) continue;
                    violation[k] = (f.aim[block] - value[k]) / f.softness[block];
                    a.square += violation[k] * violation[k];
                }
            }
        }
    }
};
