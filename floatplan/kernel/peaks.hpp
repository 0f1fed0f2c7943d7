// Largest torques and rates of flights over all times, one plan after the other.

class Measured {
  public:
    Measured(const Robot &robot, const Moments &moments, Memory &memory) : robot(robot), moments(moments), m(memory) {}

    void lay_out(Arena &arena, std::int64_t quantities, const Interpolation &finest) {
        for (double **each : {&values, &cosines}) arena.take(*each, quantities * finest.nodes);
    }

    // Torques of the motors, then rates of the joints where they are asked for, at the nodes of the motion flown last.
    void evaluate(double duration, const Interpolation &at, bool velocities) {
        const std::int64_t n = robot.joints, bodies = robot.bodies, columns = 6 + robot.width, nodes = at.nodes;
        const Vector per_second = all(1 / duration);
        Vector *joint = (Vector *)m.by_joint, *real = (Vector *)m.by_angle, *imaginary = (Vector *)m.by_swing;
        for (std::int64_t k = 0; k < nodes; k += LANES) {
            for (std::int64_t i = 0; i < n; ++i) {
                Vector curvature = all(0);
                for (std::int64_t c = 2; c < columns; ++c) {
                    double b = c < 6 ? m.boundary[6 * i + c] : m.z[i * robot.width + c - 6];
                    curvature = multiply_add(all(b), load(at.curvature + c * nodes + k), curvature);
                }
                Vector rate = load(m.rate + i * nodes + k), cosine = load(m.cosine + i * nodes + k);
                Vector swing = cosine * curvature - load(m.sine + i * nodes + k) * rate * rate;
                joint[i] = swing * per_second * per_second;
                if (velocities)
                    store(values + (moments.motors + i) * nodes + k,
                          all(moments.amplitude[i]) * cosine * rate * per_second);
            }
            // Of each body the acceleration against the base, and the square of its rate.
            Vector base_rate = load(m.base_rate + k), pull = all(0);
            for (std::int64_t a = 0; a < bodies; ++a) {
                Vector relative = a ? real[robot.parent[a]] : all(0), rate = load(m.swing + a * nodes + k) + base_rate;
                for (std::int64_t e = robot.first[a]; e < robot.first[a + 1]; ++e)
                    relative = multiply_add(all(robot.ratio[e]), joint[robot.joint[e]], relative);
                real[a] = relative;
                imaginary[a] = rate * rate;
                pull = multiply_add(load(m.inertia + a * nodes + k), relative, pull);
                pull = multiply_add(load(m.turned + a * nodes + k), imaginary[a], pull);
            }
            Vector base_acceleration = -pull * load(m.inverse + k);
            for (std::int64_t a = 0; a < bodies; ++a) {
                Vector c = load(m.body_cosine + a * nodes + k), s = load(m.body_sine + a * nodes + k);
                Vector x = real[a] + base_acceleration, y = imaginary[a];
                real[a] = c * x - s * y;
                imaginary[a] = s * x + c * y;
            }
            for (std::int64_t motor = 0; motor < moments.motors; ++motor) store(values + motor * nodes + k, all(0));
            for (std::int64_t i = 0; i < moments.bodies; ++i) {
                const double *re = moments.real + i * bodies, *im = moments.imaginary + i * bodies;
                Vector x = all(0), y = all(0);
                for (std::int64_t a = 0; a < bodies; ++a) {
                    x = multiply_add(all(re[a]), real[a], multiply_add(all(-im[a]), imaginary[a], x));
                    y = multiply_add(all(re[a]), imaginary[a], multiply_add(all(im[a]), real[a], y));
                }
                const std::int64_t group = moments.group[i];
                Vector c = load(m.body_cosine + group * nodes + k), s = load(m.body_sine + group * nodes + k);
                Vector moment = multiply_add(c, x, s * y);
                for (std::int64_t motor = 0; motor < moments.motors; ++motor) {
                    double turn = moments.turns[i * moments.motors + motor];
                    if (turn == 0) continue;
                    double *torque = values + motor * nodes + k;
                    store(torque, multiply_add(all(turn), moment, load(torque)));
                }
            }
        }
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
    const Moments &moments;
    Memory &m;
    double *values = nullptr, *cosines = nullptr;

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

static inline std::int64_t measure_batch(const Robot &robot, const Moments &moments, const Grid *grids,
                                         const Interpolation *interpolations, const Settings &settings, Peaks &peaks) {
    const std::int64_t n = robot.joints, width = robot.width, columns = 6 + width;
    const std::int64_t quantities = moments.motors + (peaks.velocities ? n : 0);
    const Interpolation &finest = interpolations[peaks.levels - 1];
    Memory m;
    Room motion, interpolation;
    Planner planner(robot, grids, settings, m);
    Measured measured(robot, moments, m);
    if (!motion.make([&](Arena &arena) { lay_out(arena, m, robot, settings, finest.nodes, n * width); }) ||
        !interpolation.make([&](Arena &arena) { measured.lay_out(arena, quantities, finest); }))
        return 1;
    for (std::int64_t row = 0; row < peaks.count; ++row) {
        const double *b = peaks.coefficients + row * n * columns, duration = peaks.duration[row];
        double power = 1;
        for (std::int64_t c = 0; c < columns; ++c, power *= duration)
            for (std::int64_t i = 0; i < n; ++i)
                (c < 6 ? m.b[6 * i + c] : m.z[i * width + c - 6]) = b[i * columns + c] * power;
        planner.h0 = peaks.momentum[row];
        double *found = peaks.peaks + row * quantities;
        bool resolved = false;
        for (std::int64_t level = 0; level < peaks.levels && !resolved; ++level) {
            const Interpolation &at = interpolations[level];
            planner.begin(duration, m.b, level);
            planner.evaluate_z();
            measured.evaluate(duration, at, peaks.velocities);
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
                return group(0, moments.motors) && group(moments.motors, quantities);
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
