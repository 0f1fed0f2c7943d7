// A whole plan without inequalities: minimise (17) subject to (14), by the SQP of floatplan/optimization/sqp.py.
// Included once for each set of instructions, with a namespace, the type Vector of LANES doubles and multiply_add().

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

// ---- lanes: the same operation on several nodes at once

using Bits = std::int64_t __attribute__((vector_size(8 * LANES)));

static inline Vector all(double value) {
    Vector result;
    for (int lane = 0; lane < LANES; ++lane) result[lane] = value;
    return result;
}

static inline Vector load(const double *from) {
    Vector result;
    std::memcpy(&result, from, sizeof result);
    return result;
}

static inline void store(double *to, Vector value) { std::memcpy(to, &value, sizeof value); }

static inline double sum(Vector value) {
    double result = 0;
    for (int lane = 0; lane < LANES; ++lane) result += value[lane];
    return result;
}

static inline Vector select(Bits mask, Vector one, Vector other) {
    return (Vector)((mask & (Bits)one) | (~mask & (Bits)other));
}

// Sine and cosine to about 1e-16: Taylor polynomials after the nearest multiple of pi/2 is taken away.
static inline void sine_cosine(Vector x, Vector &sine, Vector &cosine) {
    constexpr double round_to_whole = 6755399441055744.0;  // 1.5 * 2^52
    Vector shifted = multiply_add(x, all(0.63661977236758134), all(round_to_whole));
    Vector whole = shifted - all(round_to_whole);
    Vector r = multiply_add(whole, all(-1.5707963267341256), x);  // pi/2 in three parts, the first two of 33 bits
    r = multiply_add(whole, all(-6.0771005063039660e-11), r);
    r = multiply_add(whole, all(-2.0222662487959506e-21), r);
    Vector r2 = r * r;
    Vector s = all(1 / 355687428096000.0);
    s = multiply_add(s, r2, all(-1 / 1307674368000.0));
    s = multiply_add(s, r2, all(1 / 6227020800.0));
    s = multiply_add(s, r2, all(-1 / 39916800.0));
    s = multiply_add(s, r2, all(1 / 362880.0));
    s = multiply_add(s, r2, all(-1 / 5040.0));
    s = multiply_add(s, r2, all(1 / 120.0));
    s = multiply_add(s, r2, all(-1 / 6.0));
    s = multiply_add(s * r2, r, r);
    Vector c = all(1 / 20922789888000.0);
    c = multiply_add(c, r2, all(-1 / 87178291200.0));
    c = multiply_add(c, r2, all(1 / 479001600.0));
    c = multiply_add(c, r2, all(-1 / 3628800.0));
    c = multiply_add(c, r2, all(1 / 40320.0));
    c = multiply_add(c, r2, all(-1 / 720.0));
    c = multiply_add(c, r2, all(1 / 24.0));
    c = multiply_add(c, r2, all(-0.5));
    c = multiply_add(c, r2, all(1.0));
    Bits quadrant = (Bits)shifted, odd = -(quadrant & 1);
    sine = (Vector)((Bits)select(odd, c, s) ^ ((quadrant & 2) << 62));
    cosine = (Vector)((Bits)select(odd, s, c) ^ (((quadrant + 1) & 2) << 62));
}

// ---- a problem at the nodes of a grid

// Memory of one call, for any of its problems.
struct Memory {
    double *sine, *cosine, *rate;                          // (joints, nodes): sin p, cos p, dp/ds
    double *fixed, *fixed_rate;                            // (joints, nodes): p and dp/ds of the motion with z = 0
    double *body_cosine, *body_sine, *turned, *inertia, *swing;  // (bodies, nodes): E, Im conj(E) C E, its real part, rate
    double *base_rate, *inverse;                           // (nodes): theta0', 1/D_0
    double *by_angle, *by_swing, *angle;                   // (bodies, LANES)
    double *by_joint, *by_joint_rate, *joint_rate;         // (joints, LANES)
    double *by_z;                                          // (joints, width, LANES)
    double *z, *z_gradient;                                // (joints, width)
    double *scaling, *offset_map;                          // by number of free polynomials: (width, width), (width, 6)
    double *offset;                                        // (size)
    double *x, *row, *previous_row, *trial, *direction, *lagrangian, *mapped, *change, *product, *half;  // (size)
    double *h, *h_initial;                                 // (size, size) inverse Hessian
    double *b;                                             // (joints, 6 + width)
    double *boundary;                                      // (joints, 6)
    double *matrix;
    std::int64_t *branch;
};

struct Point {
    double objective = 0, equality = 0;
    bool differentiated = false;
    std::int64_t number = 0;  // of its evaluation
};

struct Solution {
    Status status;
    std::int64_t iterations;
};

class Planner {
  public:
    Planner(const Robot &robot, const Grid *grids, const Settings &settings, Memory &memory)
        : robot(robot), grids(grids), settings(settings), m(memory), n(robot.joints), bodies(robot.bodies),
          width(robot.width), columns(6 + robot.width) {
        for (std::int64_t i = 0; i < n; ++i) size += robot.free[i];
    }

    std::int64_t size = 0, evaluations = 0, instants = 0;

    // Whitens (17), see whitened_variables() of planning/transcription/objectives.py, for a duration.
    void whiten(double duration, const Powers &powers) {
        T = duration;
        double longest = 0;
        for (std::int64_t f = 1; f <= width; ++f) {
            bool used = false;
            for (std::int64_t i = 0; i < n; ++i) used = used || robot.free[i] == f;
            if (!used) continue;
            factor(f, powers);
            longest = larger(longest, norm(m.scaling + f * width * width, f));
        }
        unit = longest > 0 ? 1 / longest : 1;
        double square = 0;
        for (std::int64_t i = 0; i < n; ++i) {
            const double *inverse = m.scaling + robot.free[i] * width * width;
            for (std::int64_t e = 0; e < robot.free[i] * robot.free[i]; ++e) square += inverse[e] * inverse[e];
        }
        metric_norm = unit * std::sqrt(square / n);
    }

    void set_boundary(const double *boundary) {
        std::memcpy(m.boundary, boundary, 6 * n * sizeof(double));
        double *offset = m.offset;
        for (std::int64_t i = 0; i < n; ++i) {
            const double *map = m.offset_map + robot.free[i] * width * 6;
            for (std::int64_t r = 0; r < robot.free[i]; ++r, ++offset) {
                *offset = 0;
                for (int c = 0; c < 6; ++c) *offset += map[6 * r + c] * boundary[6 * i + c];
            }
        }
        level = -1;
    }

    std::int64_t current_level() const { return level; }
    double h0 = 0, change = 0;  // h, kg m^2/s; the orientation's change asked for, rad

    // z = offset + scaling x
    void free_coefficients(const double *x) {
        const double *offset = m.offset;
        for (std::int64_t i = 0; i < n; ++i) {
            std::int64_t f = robot.free[i];
            const double *inverse = m.scaling + f * width * width;
            for (std::int64_t r = 0; r < f; ++r) {
                double part = 0;
                for (std::int64_t c = r; c < f; ++c) part += inverse[r * f + c] * x[c];
                m.z[i * width + r] = offset[r] + unit * part;
            }
            for (std::int64_t r = f; r < width; ++r) m.z[i * width + r] = 0;
            x += f, offset += f;
        }
    }

    // The inverse: back substitution with the triangular scaling.
    void variables(const double *z, double *x) const {
        const double *offset = m.offset;
        for (std::int64_t i = 0; i < n; ++i) {
            std::int64_t f = robot.free[i];
            const double *inverse = m.scaling + f * width * width;
            for (std::int64_t r = f - 1; r >= 0; --r) {
                double rest = (z[i * width + r] - offset[r]) / unit;
                for (std::int64_t c = r + 1; c < f; ++c) rest -= inverse[r * f + c] * x[c];
                x[r] = rest / inverse[r * f + r];
            }
            x += f, offset += f;
        }
    }

    double metric(const double *d) const {
        double square = 0;
        for (std::int64_t i = 0; i < n; ++i) {
            std::int64_t f = robot.free[i];
            const double *inverse = m.scaling + f * width * width;
            for (std::int64_t r = 0; r < f; ++r) {
                double part = 0;
                for (std::int64_t c = r; c < f; ++c) part += inverse[r * f + c] * d[c];
                square += part * part;
            }
            d += f;
        }
        return unit * std::sqrt(square / n);
    }

    bool at_level(std::int64_t wanted) {
        if (grids[wanted].nodes == 0) return false;
        if (wanted == level) return true;
        level = wanted;
        const Grid &grid = grids[level];
        std::int64_t nodes = grid.nodes;
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t k = 0; k < nodes; k += LANES) {
                Vector p = all(0), rate = all(0);
                for (int c = 0; c < 6; ++c) {
                    Vector b = all(m.boundary[6 * i + c]);
                    p = multiply_add(b, load(grid.value + c * nodes + k), p);
                    rate = multiply_add(b, load(grid.slope + c * nodes + k), rate);
                }
                store(m.fixed + i * nodes + k, p);
                store(m.fixed_rate + i * nodes + k, rate);
            }
        return true;
    }

    Point evaluate(const double *x) {
        free_coefficients(x);
        Point point;
        for (std::int64_t k = 0; k < size; ++k) point.objective += x[k] * x[k];
        point.objective /= 2;
        point.equality = T * (robot.is_real ? fly<true>() : fly<false>()) - change;
        point.number = ++evaluations;
        instants += grids[level].nodes;
        return point;
    }

    // Derivatives of the equality by x, of the point evaluated last.
    void differentiate(Point &point, double *row) {
        if (robot.is_real) backward<true>();
        else backward<false>();
        const double *z = m.z_gradient;
        for (std::int64_t i = 0; i < n; ++i, z += width) {
            std::int64_t f = robot.free[i];
            const double *inverse = m.scaling + f * width * width;
            for (std::int64_t c = 0; c < f; ++c) {
                double part = 0;
                for (std::int64_t r = 0; r <= c; ++r) part += inverse[r * f + c] * z[r];
                row[c] = unit * part;
            }
            row += f;
        }
        point.differentiated = true;
    }

    // Tail of the Legendre coefficients of theta0', relative to its largest value.
    double unresolved() {
        const Grid &grid = grids[level];
        double tail = 0;
        fastest = 0;
        for (std::int64_t k = 0; k < grid.nodes; ++k) fastest = larger(fastest, std::fabs(m.base_rate[k]));
        for (int r = 0; r < 3; ++r) {
            double part = 0;
            for (std::int64_t k = 0; k < grid.nodes; ++k) part += grid.tail[r * grid.nodes + k] * m.base_rate[k];
            tail = larger(tail, std::fabs(part));
        }
        return tail / larger(fastest, 1e-300);
    }

    // Level at which theta0(T) is exact to an error, see PlanarFlown.level_needed().
    std::int64_t level_needed(double error) {
        double tail = smaller(larger(unresolved(), settings.smallest_tail), settings.largest_tail);
        double decay = std::log(tail) / grids[level].nodes;
        double count = std::log(error / larger(fastest * T, error)) / (2 * decay);
        for (std::int64_t candidate = 0; candidate + 1 < settings.levels; ++candidate)
            if (settings_nodes[candidate] >= count) return candidate;
        return settings.levels - 1;
    }

    const std::int64_t *settings_nodes = nullptr;  // (levels) number of nodes, also of grids that there are not yet

    // From x, see exchange.solve() of planning/transcription.
    Solution solve(double *x);
    // One stage of it, see sqp.minimise().
    Solution minimise(double *x, Point &current, const Stage &stage, bool polish, double initial_largest);

  private:
    const Robot &robot;
    const Grid *grids;
    const Settings &settings;
    Memory &m;
    std::int64_t n, bodies, width, columns, level = -1;
    double T = 0, unit = 1, metric_norm = 1, fastest = 0;

    template <bool is_real> double fly();
    template <bool is_real> void backward();

    // Householder's C = Q R of the columns of f free polynomials in powers of seconds: R^-1, and -R^-1 Q^T b_0.
    void factor(std::int64_t f, const Powers &powers) {
        std::int64_t rows = columns, across = f + 6;
        double *a = m.matrix;  // (rows, f + 6): free columns, then those of the boundary
        double per_power = 1;
        for (std::int64_t r = 0; r < rows; ++r, per_power /= T)
            for (std::int64_t c = 0; c < across; ++c)
                a[r * across + c] = powers.columns[r * columns + (c < f ? 6 + c : c - f)] * per_power;
        for (std::int64_t c = 0; c < f; ++c) {
            double square = 0, largest = 0;
            for (std::int64_t r = c; r < rows; ++r) largest = larger(largest, std::fabs(a[r * across + c]));
            for (std::int64_t r = c; r < rows; ++r) {
                double part = a[r * across + c] / largest;
                square += part * part;
            }
            double length = std::copysign(largest * std::sqrt(square), a[c * across + c]);
            double head = a[c * across + c] + length;  // the reflection's vector is (1, a[r] / head)
            for (std::int64_t r = c + 1; r < rows; ++r) a[r * across + c] /= head;
            for (std::int64_t k = c + 1; k < across; ++k) {
                double part = a[c * across + k];
                for (std::int64_t r = c + 1; r < rows; ++r) part += a[r * across + c] * a[r * across + k];
                part *= head / length;
                a[c * across + k] -= part;
                for (std::int64_t r = c + 1; r < rows; ++r) a[r * across + k] -= part * a[r * across + c];
            }
            a[c * across + c] = -length;
        }
        double *inverse = m.scaling + f * width * width, *map = m.offset_map + f * width * 6;
        for (std::int64_t c = 0; c < f; ++c)
            for (std::int64_t r = f - 1; r >= 0; --r) {
                double rest = r == c;
                for (std::int64_t k = r + 1; k <= c; ++k) rest -= a[r * across + k] * inverse[k * f + c];
                inverse[r * f + c] = r > c ? 0 : rest / a[r * across + r];
            }
        for (std::int64_t r = 0; r < f; ++r)
            for (int c = 0; c < 6; ++c) {
                double part = 0;
                for (std::int64_t k = r; k < f; ++k) part -= inverse[r * f + k] * a[k * across + f + c];
                map[6 * r + c] = part;
            }
    }

    // Largest singular value of an upper triangular matrix (f, f), by the power method.
    double norm(const double *matrix, std::int64_t f) {
        double *v = m.matrix, *w = v + f, value = 0;
        for (std::int64_t k = 0; k < f; ++k) v[k] = 1;
        for (int step = 0; step < 200; ++step) {
            double square = 0, length = 0;
            for (std::int64_t r = 0; r < f; ++r) {
                w[r] = 0;
                for (std::int64_t c = r; c < f; ++c) w[r] += matrix[r * f + c] * v[c];
                square += w[r] * w[r];
            }
            for (std::int64_t k = 0; k < f; ++k) length += v[k] * v[k];
            double before = value;
            value = std::sqrt(square / length);
            if (std::fabs(value - before) <= 1e-14 * value) break;
            for (std::int64_t c = 0; c < f; ++c) {
                v[c] = 0;
                for (std::int64_t r = 0; r <= c; ++r) v[c] += matrix[r * f + c] * w[r];
                v[c] /= square;  // only against overflow
            }
        }
        return value;
    }
};

// Integral of theta0' over [0, 1]; keeps what its derivatives need.
template <bool is_real> double Planner::fly() {
    const Grid &grid = grids[level];
    const std::int64_t nodes = grid.nodes;
    const Vector per_second = all(1 / T), h = all(h0);
    Vector total = all(0);
    Vector *rates = (Vector *)m.joint_rate, *angles = (Vector *)m.angle;
    for (std::int64_t k = 0; k < nodes; k += LANES) {
        for (std::int64_t i = 0; i < n; ++i) {
            Vector p = load(m.fixed + i * nodes + k), rate = load(m.fixed_rate + i * nodes + k), s, c;
            const double *value = grid.value + 6 * nodes + k, *slope = grid.slope + 6 * nodes + k;
            for (std::int64_t f = 0; f < robot.free[i]; ++f, value += nodes, slope += nodes) {
                Vector z = all(m.z[i * width + f]);
                p = multiply_add(z, load(value), p);
                rate = multiply_add(z, load(slope), rate);
            }
            sine_cosine(p, s, c);
            store(m.sine + i * nodes + k, s);
            store(m.cosine + i * nodes + k, c);
            store(m.rate + i * nodes + k, rate);
            rates[i] = c * rate * per_second;
        }
        store(m.body_cosine + k, all(1));
        store(m.body_sine + k, all(0));
        store(m.swing + k, all(0));
        angles[0] = all(0);
        for (std::int64_t a = 1; a < bodies; ++a) {
            Vector angle = angles[robot.from[a]], swing = load(m.swing + robot.from[a] * nodes + k), s, c;
            for (std::int64_t e = robot.first[a]; e < robot.first[a + 1]; ++e) {
                Vector ratio = all(robot.ratio[e]);
                angle = multiply_add(ratio, load(m.sine + robot.joint[e] * nodes + k), angle);
                swing = multiply_add(ratio, rates[robot.joint[e]], swing);
            }
            angles[a] = angle;
            sine_cosine(angle, s, c);
            store(m.body_cosine + a * nodes + k, c);
            store(m.body_sine + a * nodes + k, s);
            store(m.swing + a * nodes + k, swing);
        }
        Vector locked = all(0), moving = all(0);
        for (std::int64_t a = 0; a < bodies; ++a) {
            Vector x = all(0), y = all(0);
            const double *re = robot.real + a * bodies, *im = robot.imaginary + a * bodies;
            for (std::int64_t b = 0; b < bodies; ++b) {
                Vector c = load(m.body_cosine + b * nodes + k), s = load(m.body_sine + b * nodes + k);
                Vector real = all(re[b]);
                x = multiply_add(real, c, x);
                y = multiply_add(real, s, y);
                if (!is_real) {
                    Vector imaginary = all(im[b]);
                    x = multiply_add(-imaginary, s, x);
                    y = multiply_add(imaginary, c, y);
                }
            }
            Vector c = load(m.body_cosine + a * nodes + k), s = load(m.body_sine + a * nodes + k);
            Vector inertia = multiply_add(c, x, s * y);
            store(m.turned + a * nodes + k, multiply_add(c, y, -s * x));
            store(m.inertia + a * nodes + k, inertia);
            locked += inertia;
            moving = multiply_add(inertia, load(m.swing + a * nodes + k), moving);
        }
        Vector inverse = all(1) / locked, rate = (h - moving) * inverse;
        store(m.inverse + k, inverse);
        store(m.base_rate + k, rate);
        total = multiply_add(load(grid.weights + k), rate, total);
    }
    return sum(total);
}

// Adjoint of fly(): z_gradient, times the duration.
template <bool is_real> void Planner::backward() {
    const Grid &grid = grids[level];
    const std::int64_t nodes = grid.nodes;
    const Vector per_second = all(1 / T);
    Vector *by_angle = (Vector *)m.by_angle, *by_swing = (Vector *)m.by_swing;
    Vector *by_sine = (Vector *)m.by_joint, *by_rate = (Vector *)m.by_joint_rate, *by_z = (Vector *)m.by_z;
    for (std::int64_t e = 0; e < n * width; ++e) by_z[e] = all(0);
    for (std::int64_t k = 0; k < nodes; k += LANES) {
        Vector minus = -all(T) * load(grid.weights + k) * load(m.inverse + k);
        Vector twice = all(2) * load(m.base_rate + k);
        for (std::int64_t a = 0; a < bodies; ++a) {
            Vector x = all(0), y = all(0);
            const double *re = robot.real + a * bodies, *im = robot.imaginary + a * bodies;
            for (std::int64_t b = 0; b < bodies; ++b) {
                Vector swing = load(m.swing + b * nodes + k);
                Vector c = load(m.body_cosine + b * nodes + k) * swing, s = load(m.body_sine + b * nodes + k) * swing;
                Vector real = all(re[b]);
                x = multiply_add(real, c, x);
                y = multiply_add(real, s, y);
                if (!is_real) {
                    Vector imaginary = all(im[b]);
                    x = multiply_add(-imaginary, s, x);
                    y = multiply_add(imaginary, c, y);
                }
            }
            Vector c = load(m.body_cosine + a * nodes + k), s = load(m.body_sine + a * nodes + k);
            Vector by = multiply_add(c, y, -s * x);
            by = multiply_add(load(m.swing + a * nodes + k) + twice, load(m.turned + a * nodes + k), by);
            by_angle[a] = minus * by;
            by_swing[a] = minus * load(m.inertia + a * nodes + k);
        }
        for (std::int64_t i = 0; i < n; ++i) by_sine[i] = by_rate[i] = all(0);
        for (std::int64_t a = bodies - 1; a > 0; --a) {
            by_angle[robot.from[a]] += by_angle[a];
            by_swing[robot.from[a]] += by_swing[a];
            for (std::int64_t e = robot.first[a]; e < robot.first[a + 1]; ++e) {
                Vector ratio = all(robot.ratio[e]);
                by_sine[robot.joint[e]] = multiply_add(ratio, by_angle[a], by_sine[robot.joint[e]]);
                by_rate[robot.joint[e]] = multiply_add(ratio, by_swing[a], by_rate[robot.joint[e]]);
            }
        }
        for (std::int64_t i = 0; i < n; ++i) {
            Vector s = load(m.sine + i * nodes + k), c = load(m.cosine + i * nodes + k);
            Vector rate = by_rate[i] * per_second;
            Vector by_p = multiply_add(by_sine[i], c, -rate * s * load(m.rate + i * nodes + k));
            rate = rate * c;
            const double *value = grid.value + 6 * nodes + k, *slope = grid.slope + 6 * nodes + k;
            for (std::int64_t f = 0; f < robot.free[i]; ++f, value += nodes, slope += nodes)
                by_z[i * width + f] = multiply_add(by_p, load(value), multiply_add(rate, load(slope), by_z[i * width + f]));
        }
    }
    for (std::int64_t e = 0; e < n * width; ++e) m.z_gradient[e] = sum(by_z[e]);
}

// ---- dense algebra; sums over columns first, so that they are vectorised without being reordered

static inline double dot(const double *a, const double *b, std::int64_t size) {
    double result = 0;
    for (std::int64_t k = 0; k < size; ++k) result += a[k] * b[k];
    return result;
}

static inline void multiply(const double *h, const double *v, double *result, std::int64_t size) {
    for (std::int64_t k = 0; k < size; ++k) result[k] = 0;
    for (std::int64_t r = 0; r < size; ++r)
        for (std::int64_t k = 0; k < size; ++k) result[k] += h[r * size + k] * v[r];
}

static inline void identity(double *h, std::int64_t size) {
    std::memset(h, 0, size * size * sizeof(double));
    for (std::int64_t k = 0; k < size; ++k) h[k * size + k] = 1;
}

// ---- the search

inline Solution Planner::minimise(double *x, Point &current, const Stage &stage, bool polish, double largest) {
    const Settings &set = settings;
    double penalty = 0, multiplier = 0, slack_penalty = set.slack_penalty * largest;
    bool was_reset = true, is_optimal = false, h_is_initial = true;
    std::int64_t slow_steps = 0, iteration = 0;
    const double *polishing_row = m.row;
    if (size) std::memcpy(m.h_initial, m.h, size * size * sizeof(double));
    while (size && iteration < stage.iterations) {
        ++iteration;
        if (!current.differentiated) differentiate(current, m.row);
        polishing_row = m.row;
        // The step d = -H^-1 (g + A^T y), with the y for which it meets the linearised equality; g = x.
        multiply(m.h, x, m.direction, size);
        multiply(m.h, m.row, m.mapped, size);
        double curvature = dot(m.row, m.mapped, size);
        if (!(curvature > 0)) break;  // nothing turns the base
        double y = (current.equality - dot(m.row, m.direction, size)) / curvature, slope = 0, squared = 0;
        for (std::int64_t k = 0; k < size; ++k) {
            m.direction[k] = -(m.direction[k] + y * m.mapped[k]);
            m.lagrangian[k] = x[k] + y * m.row[k];
            slope += x[k] * m.direction[k];
            squared += m.direction[k] * m.direction[k];
        }
        double predicted = y * current.equality - slope;
        bool stationary = std::fabs(predicted) <= stage.optimality * (1 + std::fabs(current.objective));
        if (stationary && std::fabs(current.equality) <= stage.feasibility) {
            is_optimal = true;
            break;
        }
        double required = set.penalty_factor * std::fabs(y);
        penalty = larger(required, required + set.penalty_kept * (penalty - required));
        if (!(squared > 0) || !(required <= set.largest_multiplier * slack_penalty)) break;
        double first = 1;
        if (metric_norm * std::sqrt(squared) > set.longest_step)
            first = smaller(1.0, set.longest_step / metric(m.direction));

        // Line search for the l1 merit function.
        double violation = std::fabs(current.equality), merit = current.objective + penalty * violation;
        double descent = smaller(slope - penalty * violation, 0.0), rounding = 1e-13 * (1 + std::fabs(merit));
        double length = first;
        std::int64_t used = 0;
        bool accepted = false;
        Point trial;
        while (length > set.shortest_step * first) {
            for (std::int64_t k = 0; k < size; ++k) m.trial[k] = x[k] + length * m.direction[k];
            trial = evaluate(m.trial);
            ++used;
            double rise = trial.objective + penalty * std::fabs(trial.equality) - merit;
            if (rise <= set.armijo * length * descent + rounding) {
                accepted = true;
                break;
            }
            double lowest = -descent * length / (2 * (rise - descent * length));
            length *= smaller(set.shortening_most, larger(set.shortening_least, lowest));
        }
        slow_steps = used > set.slow_evaluations ? slow_steps + 1 : 0;
        if (!accepted || slow_steps == set.slow_steps) {
            if (was_reset) break;
            std::memcpy(m.h, m.h_initial, size * size * sizeof(double));
            h_is_initial = was_reset = true;
            slow_steps = 0;
            continue;
        }
        std::memcpy(x, m.trial, size * sizeof(double));
        double *row = m.row;
        m.row = m.previous_row;
        m.previous_row = row;
        polishing_row = m.previous_row;
        current = trial;
        if (stationary && length == 1 && std::fabs(current.equality) <= stage.feasibility) {
            is_optimal = true;
            break;
        }
        // Damped BFGS of the inverse, Nocedal and Wright (6.17), (18.14), (18.15).
        multiplier += length * (y - multiplier);
        differentiate(current, m.row);
        double approximated = 0, measured = 0;
        for (std::int64_t k = 0; k < size; ++k) {
            double step = length * m.direction[k];
            m.product[k] = -length * m.lagrangian[k];
            m.change[k] = multiplier * (m.row[k] - m.previous_row[k]) + step;
            approximated += step * m.product[k];
            measured += step * m.change[k];
        }
        if (!(approximated < 1e-20)) {
            if (measured < set.damping * approximated) {
                double damping = (1 - set.damping) * approximated / (approximated - measured);
                measured = 0;
                for (std::int64_t k = 0; k < size; ++k) {
                    m.change[k] = damping * m.change[k] + (1 - damping) * m.product[k];
                    measured += length * m.direction[k] * m.change[k];
                }
            }
            if (dot(m.change, m.change, size) < set.largest_curvature * slack_penalty * measured) {
                multiply(m.h, m.change, m.mapped, size);
                double scale = 0.5 + 0.5 * dot(m.change, m.mapped, size) / measured;
                for (std::int64_t k = 0; k < size; ++k)
                    m.half[k] = (scale * length * m.direction[k] - m.mapped[k]) / measured;
                for (std::int64_t r = 0; r < size; ++r) {
                    double step = length * m.direction[r], half = m.half[r];
                    for (std::int64_t k = 0; k < size; ++k)
                        m.h[r * size + k] += step * m.half[k] + half * length * m.direction[k];
                }
                h_is_initial = false;
            } else if (!h_is_initial) {
                std::memcpy(m.h, m.h_initial, size * size * sizeof(double));
                h_is_initial = true;
            }
        }
        was_reset = was_reset && slow_steps > 0;
    }
    if (polish && size) {
        if (!is_optimal) {
            if (!current.differentiated) differentiate(current, m.row);
            polishing_row = m.row;
        }
        double square = dot(polishing_row, polishing_row, size);
        for (std::int64_t used = 0; used < set.polishing_steps; ++used) {
            if (!(std::fabs(current.equality) > set.polished) || !(square > 0)) break;
            double y = current.equality / square;
            for (std::int64_t k = 0; k < size; ++k) m.trial[k] = x[k] - y * polishing_row[k];
            Point trial = evaluate(m.trial);
            if (!(std::fabs(trial.equality) < std::fabs(current.equality))) break;
            std::memcpy(x, m.trial, size * sizeof(double));
            current = trial;
        }
    }
    bool holds = std::fabs(current.equality) <= stage.feasibility;
    return {holds ? (is_optimal ? optimal : feasible) : infeasible, iteration};
}

inline Solution Planner::solve(double *x) {
    Point current;
    std::int64_t at = settings.first_level;
    for (;; ++at) {
        if (!at_level(at)) return {needs_grid, 0};
        current = evaluate(x);
        if (unresolved() < settings.coarsely_resolved || at + 1 == settings.levels) break;
    }
    std::int64_t order[3], stages = 0, stage = 0, iterations = 0;
    if (level_needed(settings.stages[0].quadrature_error) > at) order[stages++] = 0;
    if (level_needed(settings.stages[2].quadrature_error) > at) order[stages++] = 1;
    order[stages++] = 2;
    identity(m.h, size);
    Solution solution{infeasible, 0};
    for (std::int64_t round = 0; round < settings.most_rounds; ++round) {
        const Stage &now = settings.stages[order[stage]];
        double least = 1;
        for (std::int64_t k = 0; k < size; ++k) least = smaller(least, m.h[k * size + k]);
        bool was_last = stage + 1 == stages;
        solution = minimise(x, current, now, was_last, larger(1.0, 1 / least));
        iterations += solution.iterations;
        if (!was_last) ++stage;
        if (size && iterations > settings.most_iterations) break;
        if (solution.status == infeasible && (was_last || !(std::fabs(current.equality) <= settings.hopeless))) break;
        if (current.number != evaluations) current = evaluate(x);  // the last one was a trial that was rejected
        std::int64_t needed = level_needed(settings.stages[order[stage]].quadrature_error);
        if (needed > at) {
            at = needed;
            if (!at_level(at)) return {needs_grid, iterations};
            current = evaluate(x);
        } else if (was_last) {
            break;
        }
    }
    return {solution.status, iterations};
}
