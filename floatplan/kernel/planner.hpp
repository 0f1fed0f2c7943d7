// A problem without inequalities at the nodes of a grid: minimise (17) subject to (14).

// Memory of one call, for any of its problems.
struct Memory {
    Motion motion;                                         // sine and cosine without the amplitudes, which ratios hold
    double *fixed, *fixed_rate;                            // (joints, nodes): p and dp/ds of the motion with z = 0
    double *by_z;                                          // (joints, width, LANES)
    double *z, *z_gradient;                                // (joints, width)
    double *scaling, *offset_map;                          // by number of free polynomials: (width, width), (width, 6)
    double *offset;                                        // (size)
    double *x, *row, *previous_row, *trial, *direction, *lagrangian, *mapped, *change, *product, *half;  // (size)
    double *h, *h_initial;                                 // (size, size) inverse Hessian
    double *b;                                             // (joints, 6 + width)
    double *boundary;                                      // (joints, 6)
    double *matrix;
    Index *branch;
    double *merit;                                         // (candidates)
    Index *candidate;
};

struct Point {
    double objective = 0, equality = 0;
    bool differentiated = false;
    Index number = 0;  // of its evaluation
};

struct Solution {
    Status status;
    Index iterations;
};

// Level at which an integral of about `size` is exact to an error, from the tail that so many nodes leave.
template <typename NodesAt>
static inline Index level_of_tail(double tail, Index nodes, double error, double size, Index levels, NodesAt nodes_at) {
    const double decay = std::log(tail) / nodes, count = std::log(error / larger(size, error)) / (2 * decay);
    for (Index candidate = 0; candidate + 1 < levels; ++candidate)
        if (nodes_at(candidate) >= count) return candidate;
    return levels - 1;
}

class Planner {
  public:
    Planner(const Robot &robot, const Grid *grids, const Settings &settings, Memory &memory)
        : robot(robot), grids(grids), settings(settings), m(memory), n(robot.joints), width(robot.width),
          columns(6 + robot.width) {
        for (Index i = 0; i < n; ++i) size += robot.free[i];
    }

    Index size = 0, evaluations = 0, instants = 0;
    double h0 = 0, change = 0;               // h, kg m^2/s; the orientation's change asked for, rad
    const Index *node_counts = nullptr;  // (levels), also of grids that there are not yet

    // scaling.hpp: the variables x, for a duration and a boundary (joints, 6)
    void whiten(double duration, const Powers &powers);
    void set_boundary(const double *boundary);
    void free_coefficients(const double *x);           // z = offset + scaling x
    void variables(const double *z, double *x) const;  // the inverse
    double metric(const double *d) const;

    Index current_level() const { return level; }

    // Takes the grid of a level; false where there is none.
    bool at_level(Index wanted) {
        if (grids[wanted].nodes == 0) return false;
        if (wanted == level) return true;
        level = wanted;
        const Grid &grid = grids[level];
        const Index nodes = m.motion.instants = m.motion.stride = grid.nodes;
        for (Index i = 0; i < n; ++i)
            for (Index k = 0; k < nodes; k += LANES) {
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
        point.equality = T * fly() - change;
        point.number = ++evaluations;
        instants += grids[level].nodes;
        point.objective = dot(x, x, size) / 2;
        return point;
    }

    // Derivatives of the equality by x, of the point evaluated last.
    void differentiate(Point &point, double *row) {
        robot.is_real ? backward<true>() : backward<false>();
        each_joint([&](Index i, Index f, const double *inverse, Index first) {
            for (Index c = 0; c < f; ++c) {
                double part = 0;
                for (Index r = 0; r <= c; ++r) part += inverse[r * f + c] * m.z_gradient[i * width + r];
                row[first + c] = unit * part;
            }
        });
        point.differentiated = true;
    }

    // Tail of the Legendre coefficients of theta0', relative to its largest value.
    double unresolved() {
        const Grid &grid = grids[level];
        const Index nodes = grid.nodes;
        Vector most = all(0), last[3] = {all(0), all(0), all(0)};
        for (Index k = 0; k < nodes; k += LANES) {
            Vector rate = load(m.motion.rate + k);
            most = larger(magnitude(rate), most);
            for (int c = 0; c < 3; ++c) last[c] = multiply_add(load(grid.tail + c * nodes + k), rate, last[c]);
        }
        fastest = largest(most);
        double tail = 0;
        for (Vector each : last) tail = larger(tail, std::fabs(sum(each)));
        return tail / larger(fastest, 1e-300);
    }

    // Level at which theta0(T) is exact to an error, see PlanarFlown.level_needed().
    Index level_needed(double error) {
        double tail = smaller(larger(unresolved(), settings.smallest_tail), settings.largest_tail);
        return level_of_tail(tail, grids[level].nodes, error, fastest * T, settings.levels,
                             [&](Index candidate) { return node_counts[candidate]; });
    }

    // sqp.hpp: from x, see exchange.solve() of planning/transcription
    Solution solve(double *x, double hopeless_way);
    // One stage of it, see sqp.minimise(); ends where (14), were it linear, is so far away, rad.
    Solution minimise(double *x, Point &current, const Stage &stage, bool polish, double initial_largest,
                      double hopeless_way);

  private:
    const Robot &robot;
    const Grid *grids;
    const Settings &settings;
    Memory &m;
    Index n, width, columns, level = -1;
    double T = 0, unit = 1, metric_norm = 1, fastest = 0;

    // Calls with each joint, its number f of free polynomials, its R^-1 (f, f), and where its entries of x begin.
    template <typename Each> void each_joint(Each each) const {
        Index first = 0;
        for (Index i = 0; i < n; first += robot.free[i++])
            each(i, robot.free[i], m.scaling + robot.free[i] * width * width, first);
    }

    // Integral of theta0' over [0, 1]; keeps what its derivatives need.
    double fly() {
        const Grid &grid = grids[level];
        const Index nodes = grid.nodes;
        Motion &motion = m.motion;
        const Vector per_second = all(1 / T);
        for (Index i = 0; i < n; ++i) {
            const Index free = robot.free[i];
            const double *z = m.z + i * width;
            for (Index k = 0; k < nodes; k += LANES) {
                Vector p = load(m.fixed + i * nodes + k), rate = load(m.fixed_rate + i * nodes + k), s, c;
                const double *value = grid.value + 6 * nodes + k, *slope = grid.slope + 6 * nodes + k;
                for (Index f = 0; f < free; ++f, value += nodes, slope += nodes) {
                    p = multiply_add(all(z[f]), load(value), p);
                    rate = multiply_add(all(z[f]), load(slope), rate);
                }
                sine_cosine(p, s, c);
                store(motion.sine + i * nodes + k, s);
                store(motion.cosine + i * nodes + k, c);
                store(motion.p_rate + i * nodes + k, rate);
                store(motion.speed + i * nodes + k, c * rate * per_second);
            }
        }
        robot.is_real ? turn<true>(robot, motion, motion.sine, h0) : turn<false>(robot, motion, motion.sine, h0);
        Vector total = all(0);
        for (Index k = 0; k < nodes; k += LANES)
            total = multiply_add(load(grid.weights + k), load(motion.rate + k), total);
        return sum(total);
    }

    // Adjoint of fly(): z_gradient, times the duration.
    template <bool is_real> void backward() {
        const Grid &grid = grids[level];
        const Index nodes = grid.nodes;
        Motion &motion = m.motion;
        const Vector per_second = all(1 / T);
        Vector *by_sine = (Vector *)motion.by_joint, *by_rate = (Vector *)motion.by_joint_rate;
        Vector *by_z = (Vector *)m.by_z;
        for (Index e = 0; e < n * width; ++e) by_z[e] = all(0);
        for (Index k = 0; k < nodes; k += LANES) {
            Vector factor = -all(T) * load(grid.weights + k) * load(motion.inverse + k);
            differentiate_turn<is_real>(robot, motion, k, factor);
            for (Index i = 0; i < n; ++i) {
                Vector s = load(motion.sine + i * nodes + k), c = load(motion.cosine + i * nodes + k);
                Vector rate = by_rate[i] * per_second;
                Vector by_p = multiply_add(by_sine[i], c, -rate * s * load(motion.p_rate + i * nodes + k));
                rate = rate * c;
                const double *value = grid.value + 6 * nodes + k, *slope = grid.slope + 6 * nodes + k;
                for (Index f = 0; f < robot.free[i]; ++f, value += nodes, slope += nodes)
                    by_z[i * width + f] =
                        multiply_add(by_p, load(value), multiply_add(rate, load(slope), by_z[i * width + f]));
            }
        }
        for (Index e = 0; e < n * width; ++e) m.z_gradient[e] = sum(by_z[e]);
    }

    void factor(Index f, const Powers &powers);
    double norm(const double *matrix, Index f) const;
};
