// A flight in the plane, as Program<Flight> takes it.
//
// By (14) the orientation at landing is theta_0(0) + T sum_j w_j theta0'_j, over the Gauss nodes of a level; that it is the
// goal's is the one equality, whose derivative is the same sum of those of theta0' (tree.hpp). The orientation at other
// instants is the integral of the interpolant of theta0'. Rows are those of rows.hpp.
//
// What a flight is to a program:
//
//     Body, State          what flies; what is known of one motion beside its joints'
//     most_equalities      numbers of which the attitude at landing may lack some
//     look_at              nodes of a level, and other instants, are those of all calls from now on
//     choose_momentum      h of some variables; the conditions (13) may follow it, follow_conditions
//     turn_base            how the joints' motion turns the base, and what the attitude at landing lacks; in space some
//                          motions cannot be integrated, of which nothing is_known
//     missed               what is lacking in all, infinite where the way there is wrong
//     combine              equalities of what is lacking, and combine_rows their derivatives; scale_equalities chooses them
//     move_links           what rows and sums need beside; then write_row and write_sum give their values
//     differentiate        derivatives of what is lacking; then row_slopes and add_sum_slopes give those of rows and sums
//     has_adjoint          whether it has differentiate_backward, for programs without rows and sums
//     unresolved           what the nodes may miss of the motion, and level_needed how many more would not
//     rows_between         rows at any instants, as minima.hpp looks at them
//     chance, longest_way  what a motion tells before a search

// What is known before a search.
struct Chance {
    bool ends_hold, path_holds, path_is_clear;
};

// Level at which an integral of about `size` is exact to an error, from the tail that so many nodes leave.
template <typename NodesAt>
static inline Index level_of_tail(double tail, Index nodes, double error, double size, Index levels, NodesAt nodes_at) {
    const double decay = std::log(tail) / nodes, count = std::log(error / larger(size, error)) / (2 * decay);
    for (Index candidate = 0; candidate + 1 < levels; ++candidate)
        if (nodes_at(candidate) >= count) return candidate;
    return levels - 1;
}

class PlanarFlightEvaluator {
  public:
    using Body = Robot;
    using Rows = PlanarRowValues;
    static constexpr Index most_equalities = 1;
    static constexpr bool scales_equalities = false, has_adjoint = true;

    struct State {
        double momentum;
        double *drift, *attitude;  // (size, stride): derivatives by x of theta0' and of the orientation
        Index *has_attitude;       // (stride / 8): whether the latter are known there
    };

    const Index joints;

    PlanarFlightEvaluator(const Robot &robot, const Constraints &constraints, const Motions &motions, const Nodes *levels,
                 const Settings &settings)
        : joints(robot.joints), robot(robot), constraints(constraints), motions(motions), levels(levels),
          settings(settings), free(motions.first[robot.joints]) {}

    Index terms() const { return terms_of(robot).count(); }  // of a sum

    void lay_out(Arena &arena, Index most_nodes, Index most) {
        arena.take(own_integrals, most_nodes * most);
        arena.take(turned, most_nodes + 1);
    }

    void lay_out(Arena &arena, Motion &motion, State &state, Index most) const {
        lay_out_motion(arena, motion, robot, constraints.capsules, most);
        for (double **some : {&state.drift, &state.attitude}) arena.take(*some, motions.size * most);
        arena.take(state.has_attitude, most / 8);
    }

    // Instants s (instants), of which the nodes of a level are the first; with places of links where rows are wanted.
    void look_at(Index wanted, const double *s, Index instants, bool rows) {
        const Nodes &grid = levels[wanted];
        const Index N = grid.nodes;
        level = wanted;
        stride = instants;
        needs_integrals = constraints.needs_places && rows;
        integrals = grid.integrals;
        if (!needs_integrals || stride == N) return;
        for (Index j = 0; j < N; ++j) copy(own_integrals + j * stride, grid.integrals + j * N, N);
        integrals = own_integrals;
        for (Index k = N; k < stride; k += LANES)
            chebyshev_sums(grid.antiderivative, N + 1, N, load(s + k), stride, own_integrals + k);
    }

    void choose_momentum(State &state, const double *x) const {
        state.momentum = motions.momentum + dot(motions.axis, x + free, motions.axes);
    }

    bool conditions_follow() const { return motions.start.knots || motions.goal.knots; }

    // Conditions (13) that follow h, or by how much they change with it: boundary (joints, given).
    void follow_conditions(const State &state, bool slopes, double *boundary) const {
        follow_end(motions.start, 0, state.momentum, slopes, boundary);
        follow_end(motions.goal, 3, state.momentum, slopes, boundary);
    }

    void turn_base(Motion &motion, State &state, double *lacking) const {
        compute_base_rate(robot, motion, state.momentum);
        const Nodes &grid = levels[level];
        lacking[0] = motions.duration * dot_of_vectors(grid.weights, motion.rate, grid.nodes) - motions.change;
    }

    bool is_known(const State &) const { return true; }  // that the base turns can always be integrated

    double missed(const State &, const double *lacking) const { return std::fabs(lacking[0]); }

    // Equalities of what is lacking, and their derivatives (.., size).
    void combine(const double *lacking, double *equality) const { equality[0] = lacking[0]; }
    void combine_rows(const double *lacking, double *rows) const { copy(rows, lacking, motions.size); }
    Index scale_equalities(const double *, const double *, const double *) { return 1; }

    void move_links(Motion &motion, State &, bool rows, bool sums) const {
        if (constraints.needs_moments && (rows || sums)) move_bodies(robot, motion);
        if (!needs_integrals) return;
        integrate(motion.rate, motions.orientation, motion.attitude, 0, stride);
        place(robot, constraints, motion, 0, 0);
    }

    void differentiate(Motion &motion, State &state, const Variables &variables, double *slopes) const {
        const Nodes &grid = levels[level];
        differentiate_base_rate(robot, motion);
        for (Index k = 0; k < grid.nodes; k += LANES) chain_rate(variables, motion, joints, k, state.drift, stride);
        for (Index c = 0; c < motions.size; ++c)
            slopes[c] = motions.duration * dot_of_vectors(grid.weights, state.drift + c * stride, grid.nodes);
        std::fill(state.has_attitude, state.has_attitude + stride / 8, 0);
    }

    // The same by the coefficients of the basis (joints, columns), those from `begin` on, and by h: the adjoint of
    // turn_base(), one pass back over the nodes whatever the number of variables. `sums` has room for (joints, columns, 8).
    void differentiate_backward(Motion &motion, const double *value, const double *slope, Index begin, double *sums,
                                double *by, double *by_momentum) const {
        const Nodes &grid = levels[level];
        const Index columns = motions.columns, fixed_columns = motions.fixed_columns, *first = motions.first;
        const Vector per_second = all(motion.per_second), *by_position = (Vector *)motion.by_joint;
        const Vector *by_speed = (Vector *)motion.by_joint_rate;
        Vector *by_column = (Vector *)sums, momentum = all(0);
        const auto each_sum = [&](auto visit) {
            for (Index i = 0; i < joints; ++i)
                for (Index column = begin; column < fixed_columns + first[i + 1] - first[i]; ++column) visit(i * columns + column);
        };
        each_sum([&](Index e) { by_column[e] = all(0); });
        for (Index k = 0; k < grid.nodes; k += LANES) {
            const Vector factor = -all(motions.duration) * load(grid.weights + k) * load(motion.inverse + k);
            robot.is_real ? differentiate_base_rate<true>(robot, motion, k, factor)
                          : differentiate_base_rate<false>(robot, motion, k, factor);
            momentum -= factor;
            for (Index i = 0; i < joints; ++i) {
                const Vector s = load(motion.sine + i * stride + k), c = load(motion.cosine + i * stride + k);
                const Vector by_swing = by_speed[i] * per_second;
                const Vector by_p = multiply_add(by_position[i], c, -by_swing * s * load(motion.p_rate + i * stride + k));
                const Vector by_rate = by_swing * c;
                const Index end = fixed_columns + first[i + 1] - first[i];
                for (Index column = begin; column < end; ++column) {
                    Vector &sum = by_column[i * columns + column];
                    sum = multiply_add(by_p, load(value + column * stride + k),
                                       multiply_add(by_rate, load(slope + column * stride + k), sum));
                }
            }
        }
        each_sum([&](Index e) { by[e] = sum(by_column[e]); });
        *by_momentum = sum(momentum);
    }

    // Values (stride) of one of the rows (rows, stride), after those before it.
    void write_row(const Motion &motion, const State &, Index row, double *values) const {
        next_values<Place>(terms_of(robot), constraints, motion, row, values);
    }

    // Derivatives (size, 8) of a row at the 8 instants from one on.
    void row_slopes(Motion &motion, State &state, const Variables &variables, Index row, Index begin,
                    double *slopes) const {
        if (constraints.kind[row] > share_row && !state.has_attitude[begin / 8]++)
            for (Index c = 0; c < motions.size; ++c)
                integrate(state.drift + c * stride, 0, state.attitude + c * stride, begin, begin + 8);
        for (Index k = begin; k < begin + 8; k += LANES)
            differentiate_row(robot, constraints, motion, variables, row, k, state.attitude + k, stride, slopes);
    }

    // Values of a sum at the nodes.
    void write_sum(const Motion &motion, const State &, Index sum, double *values) const {
        sum_values(terms_of(robot), constraints, motion, sum, 0, levels[level].nodes, values);
    }

    // Adds the derivatives (size, 8) of a sum of so much of each term at the instants computed at once.
    void add_sum_slopes(Motion &motion, State &, const Variables &variables, Index k, const Vector *of_terms,
                        double *slopes) const {
        differentiate_sum(robot, motion, k, of_terms, constraints.needs_moments);
        chain(variables, motion, joints, k, constraints.needs_accelerations ? 2 : 1, slopes, 8);
    }

    // What the nodes may miss of the motion, relative to its size.
    double unresolved(const Motion &motion, const State &) const {
        const Nodes &grid = levels[level];
        Vector last[3] = {all(0), all(0), all(0)};
        for (Index k = 0; k < grid.nodes; k += LANES)
            for (int c = 0; c < 3; ++c)
                last[c] = multiply_add(load(grid.tail + c * grid.nodes + k), load(motion.rate + k), last[c]);
        double tail = 0;
        for (Vector each : last) tail = larger(tail, std::fabs(sum(each)));
        return tail / larger(fastest(motion), 1e-300);
    }

    // Level at which theta0(T) is exact to an error, see PlanarBaseMotion.level_needed() of benchmarks/sampled_flight.py.
    Index level_needed(const Motion &motion, const State &state, double error) const {
        const double tail = smaller(larger(unresolved(motion, state), settings.smallest_tail), settings.largest_tail);
        return level_of_tail(tail, levels[level].nodes, error, fastest(motion) * motions.duration, settings.levels,
                             [&](Index candidate) { return levels[candidate].nodes; });
    }

    PlanarRowValues rows_of(const Series &series) const { return {robot, constraints, &series}; }

    // The rows at any instants of a motion, of which the joints' series is given; they hold until the next call.
    PlanarRowValues rows_between(const Motion &motion, const State &state, Series &series) const {
        const Index N = levels[level].nodes;
        for (Index c = 0; c <= N; ++c)
            turned[c] = motions.duration * dot(levels[level].antiderivative + c * N, motion.rate, N);
        turned[0] += motions.orientation;
        series.momentum = state.momentum;
        series.turned = turned;
        series.turned_terms = N + 1;
        return rows_of(series);
    }

    // Whether rows hold at takeoff and landing that x does not change there; whether the CM is never deeper in an obstacle
    // than the point of the robot that stays nearest to it can be away from it: at some instants, and at all times, as far
    // as its speed, which is largest at an end, tells.
    Chance chance(const PlanarRowValues &rows, const SearchProblem &problem, Motion &close) const {
        const Minima &minima = problem.minima;
        const double ends[LANES] = {0, 1};
        rows.follow(ends, LANES, close);
        if (constraints.needs_places) {
            close.attitude[1] = motions.orientation + motions.change;  // at the goal, wherever x leads
            place(robot, constraints, close, 0, 0);
        }
        const double *path = constraints.path, duration = motions.duration;
        Chance found{true, true, true};
        for (Index row = 0; row < constraints.rows; ++row) {
            double value[LANES];
            rows.values(close, row, 0, LANES, value);
            copy(problem.end_values + 2 * row, value, 2);
            for (Index end = 0; end < 2 && !problem.at_ends[row]; ++end)
                if (end >= problem.low[row] && end <= problem.high[row])
                    found.ends_hold &= !(value[end] < -problem.tolerance[row]);
            const Index kind = constraints.kind[row], second = constraints.second[row];
            if (kind <= share_row || kind == pair_row || (row && second == constraints.second[row - 1])) continue;
            const double *obstacle = constraints.obstacles + obstacle_numbers<Place> * second;
            const double across = path[2] - obstacle[4], up = path[3] - obstacle[5];
            const double down = up - path[4] * duration;
            const double way = std::hypot(across, larger(std::fabs(up), std::fabs(down))) * duration;
            for (Index k = 0; k < minima.instants; ++k) {
                const double s = minima.grid[k], t = s * duration, before = k ? minima.grid[k - 1] : s;
                const Place com{all(path[0] + path[2] * t), all(path[1] + path[3] * t - path[4] / 2 * t * t)};
                const double distance = to_obstacle(kind, obstacle, all(t), com, com).distance[0] - obstacle[6];
                const double room = distance - constraints.margin[row] + problem.reach;
                if (s >= problem.low[row] && s <= problem.high[row]) found.path_holds &= !(room < 0);
                found.path_is_clear &= room >= way * (s - before);
            }
        }
        return found;
    }

    double longest_way(const State &, const Motion &motion) const {
        return longest_way_of_ends<Place>(constraints, motion, levels[level].nodes);
    }

  private:
    const Robot &robot;
    const Constraints &constraints;
    const Motions &motions;
    const Nodes *levels;
    const Settings &settings;
    Index free, level = -1, stride = 0;
    bool needs_integrals = false;
    const double *integrals;  // (nodes, stride)
    double *own_integrals, *turned;

    double fastest(const Motion &motion) const {
        Vector most = all(0);
        for (Index k = 0; k < levels[level].nodes; k += LANES) most = larger(magnitude(load(motion.rate + k)), most);
        return largest(most);
    }

    // What rates at the nodes turn until the instants from k to another; some at once, as each sum waits for itself.
    void integrate(const double *rates, double begin, double *to, Index k, Index end) const {
        auto next = [&](auto together) {
            Vector sums[together.value] = {};
            for (Index j = 0; j < levels[level].nodes; ++j)
                for (int each = 0; each < together.value; ++each)
                    sums[each] = add_product(rates[j], load(integrals + j * stride + k + each * LANES), sums[each]);
            for (Vector sum : sums) {
                store(to + k, all(begin) + all(motions.duration) * sum);
                k += LANES;
            }
        };
        while (k + 4 * LANES <= end) next(std::integral_constant<int, 4>());
        while (k < end) next(std::integral_constant<int, 1>());
    }

    // Conditions (13) that follow h: p' and p'' at one end, and by how much they change with it.
    void follow_end(const End &end, Index place, double momentum, bool slopes, double *boundary) const {
        if (!end.knots) return;
        Index piece = 0;
        while (piece + 2 < end.knots && momentum > end.momenta[piece + 1]) ++piece;
        const double width = end.momenta[piece + 1] - end.momenta[piece];
        const Index of_rate = motions.condition[place + 1], of_curvature = motions.condition[place + 2];
        for (Index i = 0; i < joints; ++i) {
            const double at = end.rates[piece * joints + i];
            const double slope = (end.rates[(piece + 1) * joints + i] - at) / width;
            const double rate = at + slope * (momentum - end.momenta[piece]);
            double *to = boundary + i * motions.fixed_columns;
            to[of_rate] = slopes ? slope : rate;
            if (of_curvature >= 0)
                to[of_curvature] = slopes ? 2 * end.bend[i] * rate * slope : end.curvature[i] + end.bend[i] * rate * rate;
        }
    }
};
