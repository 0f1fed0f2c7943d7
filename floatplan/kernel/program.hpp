// A flight with its rows of constraints as a nonlinear program: at the nodes of a level and at other instants, minimise an
// objective subject to what the attitude at landing lacks, (14) in the plane, and to the rows, a little inside. What flies
// is a Flight, see planar_flight.hpp.

// Values (stride) are those of rows at instants, row by row; where a row does not apply they are infinite. Derivatives are
// computed of 8 neighbouring entries at once: a pack of rows, (size, 8). What the attitude lacks are numbers (residuals),
// of which the program makes its equalities.
template <typename Flight> struct Evaluated {
    Motion motion;
    typename Flight::State state;
    double lacking[Flight::most_equalities], equality[Flight::most_equalities];
    double objective, violation, worst, squares;  // squares: of the rows' violations, summed
    double *x, *coefficients;                     // (size), (columns, joints)
    double *values, *used;                        // (rows, stride), (objective_sums, stride)
    bool differentiated;
    double *gradient, *lacking_row, *row;  // (size): of the objective; (.., size): of what is lacking, of the equalities
    double *of_axes;                       // (3, joints, axes, stride)
    Index packs, *first, *place;           // differentiated rows: first entry of `values` of each pack, and the inverse
    double *slopes;                        // (packs, size, 8)
    Variables variables;
};

// The basis of p as x combine it, joint by joint: basis (3, size, stride) from that at instants, (columns, stride) each.
static inline void combine_basis(const Motions &motions, Index n, const double *const of_columns[3], Index stride,
                                 double *basis) {
    const Index size = motions.size, free = motions.first[n];
    zero(basis, 3 * size * stride);
    for (int order = 0; order < 3; ++order)
        for (Index i = 0; i < n; ++i) {
            const Index begin = motions.first[i], end = motions.first[i + 1];
            for (Index r = begin; r < end; ++r)
                for (Index c = begin; c < end; ++c)
                    add(motions.scaling[r * free + c], of_columns[order] + (motions.fixed_columns + r - begin) * stride,
                        stride, basis + (order * size + c) * stride);
        }
}

// Coefficients (columns, n) of the basis, from x and the conditions (13) that are given, boundary (n, given).
static inline void place_coefficients(const Motions &motions, Index n, const double *x, const double *boundary,
                                      double *coefficients) {
    const Index free = motions.first[n];
    for (Index i = 0; i < n; ++i) {
        const Index begin = motions.first[i], end = motions.first[i + 1];
        for (Index c = 0; c < motions.fixed_columns; ++c) coefficients[c * n + i] = boundary[i * motions.fixed_columns + c];
        for (Index c = motions.fixed_columns + end - begin; c < motions.columns; ++c) coefficients[c * n + i] = 0;
        for (Index r = begin; r < end; ++r)
            coefficients[(motions.fixed_columns + r - begin) * n + i] =
                motions.offset[r] + dot(motions.scaling + r * free + begin, x + begin, end - begin);
    }
}

// What values lack of being positive, at as many instants as are computed at once: sum, sum of squares, largest.
struct Violations {
    Vector sum, squares, worst;

    void take(Vector value) {
        const Vector lacks = select(value < all(0), -value, all(0));
        sum += lacks;
        squares = multiply_add(lacks, lacks, squares);
        worst = larger(lacks, worst);
    }
};

template <typename Flight> class Program {
  public:
    using At = Evaluated<Flight>;
    Index size, rows, equalities = Flight::most_equalities, level = -1, stride = 0, evaluations = 0;
    double work = 0, back_off;
    bool watches = true;  // whether rows count
    const bool uses_adjoint;  // whether nothing but the attitude at landing is asked of a motion at its nodes
    Flight flight;

    Program(const typename Flight::Body &body, const Constraints &constraints, const Motions &motions,
            const Nodes *levels, const Settings &settings, const Exchange &exchange, const SearchProblem &problem)
        : size(motions.size), rows(problem.rows), back_off(exchange.back_off),
          uses_adjoint(Flight::has_adjoint && !problem.rows && !problem.objective_sums),
          flight(body, constraints, motions, levels, settings), constraints(constraints), motions(motions),
          levels(levels), exchange(exchange), problem(problem), n(flight.joints), free(motions.first[n]) {}

    void lay_out(Arena &arena, Index most_nodes) {
        const Index most = (most_nodes + exchange.most_instants + 7) / 8 * 8, e = Flight::most_equalities;
        for (At *each : {&two[0], &two[1]}) {
            flight.lay_out(arena, each->motion, each->state, most);
            for (double **some : {&each->x, &each->gradient}) arena.take(*some, size);
            for (double **some : {&each->lacking_row, &each->row}) arena.take(*some, e * size);
            arena.take(each->coefficients, motions.columns * n);
            arena.take(each->values, rows * most);
            arena.take(each->used, problem.objective_sums * most);
            arena.take(each->of_axes, 3 * n * motions.axes * most);
            for (Index **some : {&each->first, &each->place}) arena.take(*some, rows * most / 8);
            arena.take(each->slopes, rows * most * size);
        }
        if (uses_adjoint) {  // one motion's arrays stay in the processor's cache where those of two do not
            Motion shared = two[0].motion;
            shared.rate = two[1].motion.rate;
            two[1].motion = shared;
        }
        for (double *&each : beside) arena.take(each, motions.columns * most);
        arena.take(by_coefficient, motions.columns * n);
        arena.take(of_boundary, 2 * n * most);
        arena.take(known_boundary, n * motions.fixed_columns);
        arena.take(sums, motions.columns * n * 8);
        arena.take(basis, 3 * size * most);
        arena.take(s, most);
        for (double **each : {&outside, &plain}) arena.take(*each, rows * most);
        arena.take(boundary, 2 * n * motions.fixed_columns);
        arena.take(weights, 8 * flight.terms());
        arena.take(pack, 8 * size);
        arena.take(slope, size);
        arena.take(series, 3 * motions.terms * n);
        arena.take(written, 2 * motions.terms * n);
        flight.lay_out(arena, most_nodes, most);
        Series none{};
        between.lay_out(arena, flight.rows_of(none), problem.minima.instants);
    }

    At two[2] = {};

    Index nodes() const { return levels[level].nodes; }
    Index instants() const { return count; }
    double instant(Index k) const { return s[k]; }

    // Takes the nodes of a level, and other instants, rising, beside them.
    void watch(Index wanted, const double *others, Index extra) {
        const Nodes &grid = levels[wanted];
        const Index N = grid.nodes, columns = motions.columns;
        if (uses_adjoint && !extra && wanted == level && count == N) return;
        level = wanted;
        count = N + extra;
        stride = (count + 7) / 8 * 8;
        copy(s, grid.s, N);
        copy(s + N, others, extra);
        zero(s + count, stride - count);
        const double *from[3] = {grid.value, grid.first, grid.second};
        for (int order = 0; order < 3; ++order) {
            at_instants[order] = extra ? beside[order] : from[order];
            for (Index c = 0; extra && c < columns; ++c) copy(beside[order] + c * stride, from[order] + c * N, N);
        }
        for (Index k = N; k < stride; k += LANES) add_instants(k);
        flight.look_at(level, s, stride, watches);
        equalities = Flight::most_equalities;
        has_basis = is_boundary_known = false;
        if (watches) find_outside();
        for (At &each : two) {
            each.motion.instants = each.motion.stride = stride;  // beyond those asked for at takeoff
            each.motion.per_second = 1 / motions.duration;
            for (Index k = 0; !uses_adjoint && k < stride; ++k) each.motion.time[k] = motions.duration * s[k];
            each.variables = {size, stride, basis, motions.first, motions.axis, nullptr};
        }
    }

    // Values at at.x.
    void evaluate(At &at) {
        move(at);
        at.differentiated = false;
        ++evaluations;
        work += exchange.evaluation + count * problem.bodies;
        if (!is_known(at)) return nothing_known(at);
        flight.move_links(at.motion, at.state, watches, problem.objective_sums);
        if (watches) evaluate_rows(at);
        at.objective = objective(at);
    }

    // The squared violations at at.x; of the equalities and some rows alone where these are enough.
    double squares(At &at, double enough) {
        move(at);
        if (!is_known(at)) return HUGE_VAL;
        double missed = 0;
        for (Index e = 0; e < equalities; ++e) missed += at.equality[e] * at.equality[e];
        if (missed >= enough) return missed;
        flight.move_links(at.motion, at.state, watches, problem.objective_sums);
        evaluate_rows(at, enough - missed);
        return missed + at.squares;
    }

    // Makes equalities of what the attitude at landing lacks that are changed about as easily as one another, by steps
    // that are as long in the metric; in space x are z, and that is diagonal.
    void scale_equalities(At &at) {
        if (!Flight::scales_equalities || !is_known(at)) return;
        differentiate(at);
        for (Index a = 0; a < size; ++a) slope[a] = a < free ? std::sqrt(static_cast<double>(n)) : 1;
        equalities = flight.scale_equalities(at.lacking, at.lacking_row, slope);
        flight.combine_rows(at.lacking_row, at.row);
        sum_equalities(at);
        if (watches) sum_rows(at);
    }

    // Gradient and equalities by x.
    void differentiate(At &at) {
        if (at.differentiated || !is_known(at)) return;
        at.differentiated = true;
        if (!uses_adjoint && !std::exchange(has_basis, true)) combine_basis(motions, n, at_instants, stride, basis);
        if (flight.conditions_follow()) follow_axes(at);
        if constexpr (Flight::has_adjoint)
            if (uses_adjoint) differentiate_backward(at);
        if (!uses_adjoint) flight.differentiate(at.motion, at.state, at.variables, at.lacking_row);
        flight.combine_rows(at.lacking_row, at.row);
        differentiate_objective(at);
        at.packs = 0;
        if (!watches || !rows) return;
        for (Index number = 0; number < rows * stride / 8; ++number) at.place[number] = -1;
        work += exchange.differentiation + exchange.entry * count * size * problem.entries;
    }

    // Rows that are below so much.
    void differentiate_rows(At &at, double reach) {
        for (Index entry = 0; watches && entry < rows * stride; entry += LANES)
            if (at.place[entry / 8] < 0 && any(load(at.values + entry) < all(reach))) pack_of(at, entry);
    }

    // Derivatives (size, 8) of the 8 entries of the values about one.
    const double *pack_of(At &at, Index entry) {
        Index &place = at.place[entry / 8];
        if (place >= 0) return at.slopes + place * size * 8;
        const Index row = entry / stride, begin = entry % stride / 8 * 8;
        double *slopes = at.slopes + at.packs * size * 8;
        flight.row_slopes(at.motion, at.state, at.variables, row, begin, slopes);
        at.first[at.packs] = entry / 8 * 8;
        place = at.packs++;
        return slopes;
    }

    // Adds the derivatives (size) of one entry of the values, times a factor.
    void add_slopes(At &at, Index entry, double factor, double *result) {
        const double *slopes = pack_of(at, entry) + entry % 8;
        for (Index c = 0; c < size; ++c) result[c] += factor * slopes[8 * c];
    }

    // A positive definite first guess (size, size) of the Lagrangian's Hessian (objective.hpp).
    void guess_hessian(At &at, double *hessian);

    // The x of free coefficients z (free), where the scaling of each joint is upper triangular, as that of (17) is.
    void variables(const double *z, double *x) const {
        for (Index i = 0; i < n; ++i) {
            const Index end = motions.first[i + 1];
            for (Index r = end; r-- > motions.first[i];) {
                const double *row = motions.scaling + r * free;
                x[r] = (z[r] - motions.offset[r] - dot(row + r + 1, x + r + 1, end - r - 1)) / row[r];
            }
        }
    }

    // Length of a step, see DecisionVariables.metric.
    double metric(const double *step) const {
        double square = 0;
        for (Index i = 0; i < n; ++i)
            for (Index r = motions.first[i]; r < motions.first[i + 1]; ++r) {
                const double moved = dot(motions.scaling + r * free + motions.first[i], step + motions.first[i],
                                         motions.first[i + 1] - motions.first[i]);
                square += moved * moved / n;
            }
        return std::sqrt(square + dot(step + free, step + free, size - free));
    }

    // No step of length 1 in x is longer.
    double largest_metric() const {
        return std::sqrt(dot(motions.scaling, motions.scaling, free * free) / n);
    }

    // The matrix of its squares (size, size).
    void metric_matrix(double *matrix) const {
        zero(matrix, size * size);
        for (Index i = 0; i < n; ++i)
            for (Index r = motions.first[i]; r < motions.first[i + 1]; ++r)
                for (Index a = motions.first[i]; a < motions.first[i + 1]; ++a)
                    for (Index b = motions.first[i]; b < motions.first[i + 1]; ++b)
                        matrix[a * size + b] += motions.scaling[r * free + a] * motions.scaling[r * free + b] / n;
        for (Index a = free; a < size; ++a) matrix[a * size + a] = 1;
    }

    // What the nodes may miss of the motion, relative to its size.
    double unresolved(const At &at) const { return flight.unresolved(at.motion, at.state); }

    Index level_needed(const At &at, double error) const { return flight.level_needed(at.motion, at.state, error); }

    bool is_known(const At &at) const { return flight.is_known(at.state); }  // whether it could be integrated

    // What the attitude at landing lacks in all; infinite where nothing is known of it.
    double missed(const At &at) const {
        return is_known(at) ? flight.missed(at.state, at.lacking) : HUGE_VAL;
    }

    // Local minima of the rows over the whole motion.
    void look(const At &at, Minima &minima) {
        minima.found = 0;
        if (!rows || !is_known(at)) return;
        Series whole = series_of(at);
        find_minima(flight.rows_between(at.motion, at.state, whole), minima, between);
        work += exchange.evaluation * (1 + minima.found) + (minima.instants + minima.looked) * problem.bodies;
    }

    // Minima lower than `enough(row)` that a look as close as the nodes adds, where these are closer than the instants of
    // a look: two dips of a row side by side between two of these instants are one there. It counts as no work: it is taken
    // where nothing else is left to do.
    template <typename Enough> void look_closer(const At &at, Minima &minima, const Enough &enough) {
        const Index closer = (nodes() + minima.instants - 1) / minima.instants;
        if (!rows || !is_known(at) || closer < 2) return;
        Series whole = series_of(at);
        add_closer_minima(flight.rows_between(at.motion, at.state, whole), minima, closer, enough, between);
    }

    // What at.x tells before a search.
    Chance chance(const At &at) {
        if (!is_known(at)) return {true, true, true};
        Series whole = series_of(at);
        return flight.chance(flight.rows_between(at.motion, at.state, whole), problem, between.close);
    }

  private:
    Series series_of(const At &at) {
        const Index terms = motions.terms;
        for (int order = 0; order < 3; ++order)
            multiply(motions.series + order * terms * motions.columns, terms, motions.columns, at.coefficients, n,
                     series + order * terms * n);
        return {terms, 0, motions.duration, 0, series, series + terms * n, series + 2 * terms * n, nullptr,
                motions.centre, motions.amplitude};
    }

    const Constraints &constraints;
    const Motions &motions;
    const Nodes *levels;
    const Exchange &exchange;
    const SearchProblem &problem;
    Index n, free, count = 0;
    bool has_basis = false;
    const At *moved = nullptr;  // whose joints and base were moved last
    const double *at_instants[3];  // (columns, stride): the functions that p is a sum of, and their derivatives by s
    double *beside[3];             // the same where there are instants beside the nodes
    double *by_coefficient, *sums;
    bool is_boundary_known = false;  // what is kept of the conditions (13), and these
    double *of_boundary, *known_boundary;
    double *basis, *s, *outside, *plain, *boundary, *weights, *pack;
    double *slope, *series, *written;
    MinimaWorkspace<typename Flight::Rows> between;

    // Joints and base, and what the attitude at landing lacks.
    void move(At &at) {
        moved = &at;
        flight.choose_momentum(at.state, at.x);
        copy(boundary, motions.boundary, n * motions.fixed_columns);
        flight.follow_conditions(at.state, false, boundary);
        place_coefficients(motions, n, at.x, boundary, at.coefficients);
        if (uses_adjoint) {
            swing_alone(at.motion, at.coefficients);
        } else {
            combine(at.motion, n, at.coefficients, motions.columns, at_instants[0], at_instants[1], at_instants[2]);
            swing_joints(n, at.motion, motions.centre, motions.amplitude);
        }
        flight.turn_base(at.motion, at.state, at.lacking);
        sum_equalities(at);
    }

    // Positions and speeds of the joints; what the conditions (13) make of p is kept as long as these are the same.
    void swing_alone(Motion &motion, const double *coefficients) {
        const Index fixed_columns = motions.fixed_columns;
        if (!is_boundary_known || !std::equal(boundary, boundary + n * fixed_columns, known_boundary)) {
            combine_first(motion, n, boundary, fixed_columns, at_instants[0], at_instants[1], of_boundary);
            copy(known_boundary, boundary, n * fixed_columns);
            is_boundary_known = true;
        }
        swing_joints(n, motion, of_boundary, coefficients + fixed_columns * n, motions.columns - fixed_columns,
                     at_instants[0] + fixed_columns * stride, at_instants[1] + fixed_columns * stride, motions.centre,
                     motions.amplitude);
    }

    // Derivatives by x of what the attitude at landing lacks, from those by the coefficients of the basis.
    void differentiate_backward(At &at) {
        const double *by_axis = flight.conditions_follow() ? boundary + n * motions.fixed_columns : nullptr;
        const Index begin = by_axis ? 0 : motions.fixed_columns;
        double by_momentum = 0;
        if (moved != &at) move(at);
        flight.differentiate_backward(at.motion, at_instants[0], at_instants[1], begin, sums, by_coefficient,
                                      &by_momentum);
        zero(at.lacking_row, size);
        for (Index i = 0; i < n; ++i) {
            const Index from = motions.first[i], end = motions.first[i + 1];
            const double *by = by_coefficient + i * motions.columns;
            for (Index r = from; r < end; ++r)
                add(by[motions.fixed_columns + r - from], motions.scaling + r * free + from, end - from, at.lacking_row + from);
            if (by_axis) at.lacking_row[free] += dot(by, by_axis + i * motions.fixed_columns, motions.fixed_columns);
        }
        if (motions.axes) at.lacking_row[free] += motions.axis[0] * by_momentum;
    }

    void sum_equalities(At &at) {
        flight.combine(at.lacking, at.equality);
        at.violation = at.worst = at.squares = 0;
        for (Index e = 0; e < equalities; ++e) {
            at.violation += std::fabs(at.equality[e]);
            at.worst = larger(at.worst, std::fabs(at.equality[e]));
        }
    }

    // Of a motion that cannot be integrated.
    void nothing_known(At &at) {
        for (double &each : at.equality) each = HUGE_VAL;
        at.objective = at.violation = at.worst = at.squares = HUGE_VAL;
        std::fill(at.values, at.values + (watches ? rows * stride : 0), HUGE_VAL);
    }

    // The basis at instants beside the nodes.
    void add_instants(Index k) {
        const Index columns = motions.columns, terms = motions.terms;
        const Vector at = load(s + k);
        for (int order = 0; order < 3; ++order)
            chebyshev_sums(motions.series + order * terms * columns, terms, columns, at, stride, beside[order] + k);
    }

    // Infinite where a row does not apply, else 0.
    void find_outside() {
        for (Index row = 0; row < rows; ++row)
            for (Index k = 0; k < stride; k += LANES) {
                const Vector at = load(s + k);
                Bits applies = (at >= all(problem.low[row])) & (at <= all(problem.high[row]));
                if (!problem.at_ends[row]) applies &= (at > all(exchange.near_end)) & (at < all(1 - exchange.near_end));
                store(outside + row * stride + k, select(applies, all(0), all(HUGE_VAL)));
            }
        for (Index row = 0; row < rows; ++row)
            for (Index k = count; k < stride; ++k) outside[row * stride + k] = HUGE_VAL;
    }

    // By how much p and its derivatives at all instants, and the conditions themselves, change with the axis of h.
    void follow_axes(At &at) {
        double *by = boundary + n * motions.fixed_columns;
        zero(by, n * motions.fixed_columns);
        flight.follow_conditions(at.state, true, by);
        for (Index e = 0; e < n * motions.fixed_columns; ++e) by[e] *= motions.axis[0];
        if (uses_adjoint) return;
        zero(at.of_axes, 3 * n * stride);
        for (int order = 0; order < 3; ++order)
            for (Index i = 0; i < n; ++i)
                for (Index c = 0; c < motions.fixed_columns; ++c)
                    add(by[i * motions.fixed_columns + c], at_instants[order] + c * stride, stride,
                        at.of_axes + (order * n + i) * stride);
        at.variables.of_axes = at.of_axes;
    }

    // Values of all rows, and by how much they are violated; of the first rows alone where their squares are enough.
    void evaluate_rows(At &at, double enough = HUGE_VAL) {
        Violations of_rows{all(0), all(0), all(0)};
        for (Index row = 0; row < rows && !(sum(of_rows.squares) > enough); ++row) {
            flight.write_row(at.motion, at.state, row, plain);
            for (Index k = 0; k < stride; k += LANES) {
                const Index entry = row * stride + k;
                store(at.values + entry, load(plain + entry) - all(back_off) + load(outside + entry));
                of_rows.take(load(at.values + entry));
            }
        }
        add_violations(at, of_rows);
    }

    // The same of values that are known.
    void sum_rows(At &at) {
        Violations of_rows{all(0), all(0), all(0)};
        for (Index entry = 0; entry < rows * stride; entry += LANES) of_rows.take(load(at.values + entry));
        add_violations(at, of_rows);
    }

    void add_violations(At &at, const Violations &of_rows) {
        at.violation += sum(of_rows.sum);
        at.squares = sum(of_rows.squares);
        at.worst = larger(at.worst, largest(of_rows.worst));
    }

    // objective.hpp
    double objective(const At &at);
    void differentiate_objective(At &at);
    void add_gauss_newton(At &at, double *hessian);
    void add_normals(Vector weight, double *hessian) const;
    template <typename Visit> void each_slope_of_b(Visit visit);
};
