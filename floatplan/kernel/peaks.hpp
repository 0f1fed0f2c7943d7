// Largest torques, rates and accelerations of flights over all times, and least distances, one plan after the other.

class Measured {
  public:
    Measured(const Robot &robot, const Peaks &peaks) : robot(robot), peaks(peaks) {}

    Index quantities() const { return peaks.motors + peaks.orders * robot.joints; }

    void lay_out(Arena &arena, Index nodes) {
        lay_out_motion(arena, motion, robot, 0, nodes);
        lay_out_motion(arena, close, robot, 0, 1);
        arena.take(b, peaks.columns * robot.joints);
        arena.take(powers, 3 * peaks.columns * close.stride);
        arena.take(values, quantities() * nodes);
        arena.take(series, (2 * peaks.columns + 1) * robot.joints);
        for (double **each : {&turned, &at_nodes}) arena.take(*each, nodes + 2);
    }

    // Takes a plan.
    void begin(Index row) {
        const Index n = robot.joints, columns = peaks.columns;
        momentum = peaks.momentum[row];
        centre = peaks.centre + row * n;
        amplitude = peaks.amplitude + row * n;
        motion.per_second = close.per_second = 1 / peaks.duration[row];
        double power = 1;
        for (Index c = 0; c < columns; ++c, power *= peaks.duration[row])
            for (Index i = 0; i < n; ++i)
                b[c * n + i] = peaks.coefficients[(row * n + i) * columns + c] * power;
        zero(powers, 3 * columns * close.stride);
    }

    // Takes the quantities at the nodes: torques of the motors, then rates of the joints where they are wanted.
    void evaluate(const Interpolation &at) {
        motion.instants = motion.stride = at.nodes;
        follow_powers(motion, at.value, at.slope, at.curvature);
        for (Index quantity = 0; quantity < quantities(); ++quantity)
            look(motion, quantity, values + quantity * at.nodes);
    }

    // The torques are resolved where their largest tail is small against the largest of them; so are rates, which
    // resolve what is slower to begin with.
    bool is_resolved(const Interpolation &at) const {
        auto of = [&](Index first, Index stop) {
            double most = 0, left = 0;
            for (const double *value = values + first * at.nodes; first < stop; ++first, value += at.nodes) {
                for (Index k = 0; k < at.nodes; ++k) most = larger(std::fabs(value[k]), most);
                for (const double *tail = at.map + (at.nodes - 3) * at.nodes; tail < at.map + at.nodes * at.nodes;
                     tail += at.nodes)
                    left = larger(std::fabs(dot(tail, value, at.nodes)), left);
            }
            return left <= peaks.resolved * most;
        };
        return of(0, peaks.motors) && of(peaks.motors, peaks.motors + (peaks.orders > 0) * robot.joints);
    }

    // Largest magnitude of a quantity: narrowed down from every node that its neighbours let be near the largest.
    double largest(Index quantity, const Interpolation &at) {
        const double *value = values + quantity * at.nodes;
        auto magnitude = [&](Index k) { return k < 0 || k == at.nodes ? 0 : std::fabs(value[k]); };
        double found = 0;
        for (Index k = 0; k < at.nodes; ++k) found = larger(magnitude(k), found);
        for (Index k = 1; k + 1 < at.nodes; ++k) {
            const double here = magnitude(k), before = magnitude(k - 1), after = magnitude(k + 1);
            if (here < before || here < after || 2 * here - smaller(before, after) <= found) continue;
            Narrowing narrowing;
            narrowing.begin(at.s[k - 1], at.s[k + 1], at.s[k], -here);
            while (narrowing.next()) narrowing.take(-magnitude_at(quantity, narrowing.wanted));
            found = larger(-narrowing.fx, found);
        }
        return found;
    }

    // Least of the distances that the constraints have rows of; infinite where none exists. False without memory.
    bool find_clearance(Index row, const Interpolation &at, Constraints constraints) {
        const Index n = robot.joints, columns = peaks.columns, N = at.nodes;
        constraints.path = peaks.path + 5 * row;
        constraints.obstacles = peaks.obstacles + peaks.numbers * row;
        Minima minima = peaks.minima;
        minima.low = peaks.low + row * constraints.rows;
        minima.high = peaks.high + row * constraints.rows;
        for (Index i = 0; i < n; ++i) {
            zero(at_nodes, N);
            for (Index c = 0; c < columns; ++c) add(b[c * n + i], at.value + c * N, N, at_nodes);
            for (Index c = 0; c < columns; ++c) {
                series[c * n + i] = dot(at.map + c * N, at_nodes, N);
                series[(columns + c) * n + i] = dot(at.map + c * N, motion.p_rate + i * motion.stride, N);
            }
        }
        // The turn until s: of T_c it is (T_(c+1) / (c + 1) - T_(c-1) / (c - 1)) / 4, with T_1 / 2 and T_2 / 8 first.
        for (Index c = 0; c < N; ++c) at_nodes[c] = dot(at.map + c * N, motion.rate, N);
        at_nodes[N] = at_nodes[N + 1] = turned[0] = 0;
        for (Index c = 1; c <= N; ++c) {
            turned[c] = peaks.duration[row] * (at_nodes[c - 1] * (c == 1 ? 2 : 1) - at_nodes[c + 1]) / (4 * c);
            turned[0] += c % 2 ? turned[c] : -turned[c];
        }
        turned[0] += peaks.orientation[row];
        const double *rates = series + columns * n;
        const Series whole{columns, N + 1, peaks.duration[row], momentum, series, rates, rates, turned, centre, amplitude};
        if (find_minima(PlanarRowValues{robot, constraints, &whole}, minima)) return false;
        peaks.clearance[row] = HUGE_VAL;
        for (Index k = 0; k < minima.found; ++k) peaks.clearance[row] = smaller(peaks.clearance[row], minima.value[k]);
        return true;
    }

  private:
    const Robot &robot;
    const Peaks &peaks;
    const double *centre = nullptr, *amplitude = nullptr;
    double *series = nullptr, *turned = nullptr, *at_nodes = nullptr;
    Motion motion{}, close{};  // at the nodes, and at one instant
    double momentum = 0, *b = nullptr, *powers = nullptr, *values = nullptr;  // b (columns, joints) in powers of s

    void follow_powers(Motion &m, const double *value, const double *slope, const double *curvature) {
        combine(m, robot.joints, b, peaks.columns, value, slope, curvature);
        swing_joints(robot.joints, m, centre, amplitude);
        compute_base_rate(robot, m, momentum);
        move_bodies(robot, m);
    }

    void look(const Motion &m, Index quantity, double *result) const {
        const Index joint = quantity - peaks.motors, n = robot.joints;
        const double *of_joint = joint < n ? m.speed + joint * m.stride : m.acceleration + (joint - n) * m.stride;
        for (Index k = 0; k < m.instants; k += LANES)
            store(result + k, joint < 0 ? motor_torque(robot.links, m, peaks.turns + quantity, peaks.motors, k)
                                        : load(of_joint + k));
    }

    double magnitude_at(Index quantity, double s) {
        const Index columns = peaks.columns, apart = columns * close.stride;
        double power = 1, before = 0, earlier = 0, there[LANES];
        for (Index c = 0; c < columns; ++c, earlier = before, before = power, power *= s) {
            double *of = powers + c * close.stride;
            of[0] = power;
            of[apart] = c * before;
            of[2 * apart] = c * (c - 1) * earlier;
        }
        follow_powers(close, powers, powers + apart, powers + 2 * apart);
        look(close, quantity, there);
        return std::fabs(there[0]);
    }
};

Index measure_batch(const Robot &robot, const Interpolation *interpolations,
                    const Constraints *constraints, Peaks &peaks) {
    const Index last = peaks.levels - 1;
    Workspace room;
    Measured measured(robot, peaks);
    if (!room.make([&](Arena &arena) { measured.lay_out(arena, interpolations[last].nodes); })) return 1;
    const Index quantities = measured.quantities();
    for (Index row = 0; row < peaks.count; ++row) {
        measured.begin(row);
        Index level = 0;
        for (measured.evaluate(interpolations[0]); level < last && !measured.is_resolved(interpolations[level]);)
            measured.evaluate(interpolations[++level]);
        for (Index quantity = 0; quantity < quantities; ++quantity)
            peaks.peaks[row * quantities + quantity] = measured.largest(quantity, interpolations[level]);
        if (constraints && !measured.find_clearance(row, interpolations[level], *constraints)) return 1;
    }
    return 0;
}
