// Largest torques and rates of flights over all times, one plan after the other.

class Measured {
  public:
    Measured(const Robot &robot, const Peaks &peaks) : robot(robot), peaks(peaks) {}

    void lay_out(Arena &arena, std::int64_t quantities, const Interpolation &finest) {
        lay_out_motion(arena, motion, robot, 0, finest.nodes);
        arena.take(b, peaks.columns * robot.joints);
        for (double **each : {&values, &cosines}) arena.take(*each, quantities * finest.nodes);
    }

    // Takes a plan.
    void begin(std::int64_t row) {
        const std::int64_t n = robot.joints, columns = peaks.columns;
        momentum = peaks.momentum[row];
        motion.per_second = 1 / peaks.duration[row];
        double power = 1;
        for (std::int64_t c = 0; c < columns; ++c, power *= peaks.duration[row])
            for (std::int64_t i = 0; i < n; ++i)
                b[c * n + i] = peaks.coefficients[(row * n + i) * columns + c] * power;
    }

    // Torques of the motors, then rates of the joints where they are wanted, at the nodes.
    void evaluate(const Interpolation &at) {
        const std::int64_t nodes = motion.instants = motion.stride = at.nodes;
        combine(motion, robot.joints, b, peaks.columns, at.value, at.slope, at.curvature);
        swing_joints(robot, motion, peaks.centre, peaks.amplitude);
        turn(robot, motion, momentum);
        move_bodies(robot, motion);
        for (std::int64_t motor = 0; motor < peaks.motors; ++motor)
            for (std::int64_t k = 0; k < nodes; k += LANES)
                store(values + motor * nodes + k, motor_torque(robot, motion, peaks.turns + motor, peaks.motors, k));
        if (peaks.velocities)
            std::memcpy(values + peaks.motors * nodes, motion.speed, robot.joints * nodes * sizeof(double));
    }

    // Takes the Chebyshev series of a quantity's values.
    void transform(std::int64_t quantity, const Interpolation &at) {
        constexpr std::int64_t TOGETHER = 32 / LANES;
        const double *value = values + quantity * at.nodes;
        for (std::int64_t row = 0; row < at.nodes; row += 32) {
            Vector sums[TOGETHER];
            for (Vector &sum : sums) sum = all(0);
            for (std::int64_t k = 0; k < at.nodes; ++k) {
                Vector factor = all(value[k]);
                const double *column = at.to_cosines + k * at.nodes + row;
                for (std::int64_t part = 0; part < TOGETHER; ++part)
                    sums[part] = multiply_add(factor, load(column + part * LANES), sums[part]);
            }
            for (std::int64_t part = 0; part < TOGETHER; ++part)
                store(cosines + quantity * at.nodes + row + part * LANES, sums[part]);
        }
    }

    double tail(std::int64_t quantity, const Interpolation &at) const {
        const double *last = cosines + (quantity + 1) * at.nodes - 3;
        return larger(larger(std::fabs(last[0]), std::fabs(last[1])), std::fabs(last[2]));
    }

    // No value of the interpolant is larger.
    double bound(std::int64_t quantity, const Interpolation &at) const {
        double result = 0;
        for (std::int64_t j = 0; j < at.nodes; ++j) result += std::fabs(cosines[quantity * at.nodes + j]);
        return result;
    }

    // Largest magnitude of the interpolant. Of the finer grid that part is evaluated where it may be: between nodes a
    // function is no larger than there, but for an eighth of their squared distance times its largest curvature.
    double largest(std::int64_t quantity, const Interpolation &at) const {
        const double *value = values + quantity * at.nodes;
        const std::int64_t fineness = (at.points - 1) / (at.nodes - 1);
        const double step = 3.141592653589793 / (at.points - 1);
        double bend = 0;
        for (std::int64_t j = 0; j < at.nodes; ++j) bend += double(j * j) * std::fabs(cosines[quantity * at.nodes + j]);
        const double margin = bend * (step * fineness) * (step * fineness) / 8;
        double found = std::fabs(value[0]);
        std::int64_t where = 0;
        for (std::int64_t k = 1; k < at.nodes; ++k)
            if (std::fabs(value[k]) > found) found = std::fabs(value[k]), where = k * fineness;
        for (std::int64_t k = 0; k + 1 < at.nodes; ++k)
            if (larger(std::fabs(value[k]), std::fabs(value[k + 1])) + margin > found)
                for (std::int64_t point = k * fineness + 1; point < (k + 1) * fineness; ++point) {
                    double there = magnitude(value, at, point);
                    if (there > found) found = there, where = point;
                }
        if (where == 0 || where == at.points - 1) return found;
        double before = magnitude(value, at, where - 1), after = magnitude(value, at, where + 1);
        double bent = before - 2 * found + after;
        if (!(bent < 0)) return found;
        double there, slope, curvature;
        sums(cosines + quantity * at.nodes, at.nodes, step * (where + (before - after) / (2 * bent)), there, slope,
             curvature);
        if (!(there * curvature < 0)) return found;
        double move = larger(-step, smaller(step, -slope / curvature));
        return larger(found, std::fabs(there + slope * move / 2));
    }

  private:
    const Robot &robot;
    const Peaks &peaks;
    Motion motion{};
    double momentum = 0, *b = nullptr, *values = nullptr, *cosines = nullptr;  // b (columns, joints) in powers of s

    static double magnitude(const double *value, const Interpolation &at, std::int64_t point) {
        Vector total = all(0);
        for (std::int64_t k = 0; k < at.nodes; k += LANES)
            total = multiply_add(load(at.to_fine + point * at.nodes + k), load(value + k), total);
        return std::fabs(sum(total));
    }

    // sum_j c_j cos(j phi), and its first and second derivative by phi.
    static void sums(const double *series, std::int64_t nodes, double phi, double &value, double &slope,
                     double &curvature) {
        Vector zeroth = all(0), first = all(0), second = all(0), j = all(0);
        for (int lane = 0; lane < LANES; ++lane) j[lane] = lane;
        for (std::int64_t k = 0; k < nodes; k += LANES, j += all(LANES)) {
            Vector sine, cosine, factor = load(series + k);
            sine_cosine(j * all(phi), sine, cosine);
            zeroth += factor * cosine;
            first -= j * factor * sine;
            second -= j * j * factor * cosine;
        }
        value = sum(zeroth);
        slope = sum(first);
        curvature = sum(second);
    }
};

static inline std::int64_t measure_batch(const Robot &robot, const Interpolation *interpolations, Peaks &peaks) {
    const std::int64_t quantities = peaks.motors + (peaks.velocities ? robot.joints : 0);
    Room room;
    Measured measured(robot, peaks);
    if (!room.make([&](Arena &arena) { measured.lay_out(arena, quantities, interpolations[peaks.levels - 1]); }))
        return 1;
    for (std::int64_t row = 0; row < peaks.count; ++row) {
        measured.begin(row);
        double *found = peaks.peaks + row * quantities;
        bool resolved = false;
        for (std::int64_t level = 0; level < peaks.levels && !resolved; ++level) {
            const Interpolation &at = interpolations[level];
            measured.evaluate(at);
            for (std::int64_t quantity = 0; quantity < quantities; ++quantity) measured.transform(quantity, at);
            // The torques are resolved where their largest tail is small against the largest of them; so are the rates.
            auto resolves = [&](auto size) {
                auto group = [&](std::int64_t first, std::int64_t stop) {
                    double most = 0, left = 0;
                    for (std::int64_t quantity = first; quantity < stop; ++quantity) {
                        most = larger(size(quantity), most);
                        left = larger(measured.tail(quantity, at), left);
                    }
                    return left <= peaks.resolved * most;
                };
                return group(0, peaks.motors) && group(peaks.motors, quantities);
            };
            bool is_last = level + 1 == peaks.levels;
            if (!is_last && !resolves([&](std::int64_t quantity) { return measured.bound(quantity, at); })) continue;
            for (std::int64_t quantity = 0; quantity < quantities; ++quantity)
                found[quantity] = measured.largest(quantity, at);
            resolved = resolves([&](std::int64_t quantity) { return found[quantity]; });
        }
    }
    return 0;
}
