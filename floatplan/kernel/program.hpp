// A flight with its rows of constraints as a nonlinear program, FlightProgram of planning/transcription/program.py: at
// the nodes of a level and at other instants, minimise an objective subject to (14) and to the rows, a little inside.

// Values (stride) are those of rows at instants, row by row; where a row does not apply they are infinite. Derivatives are
// computed of 8 neighbouring entries at once: a pack of rows, (size, 8).
struct Evaluated {
    Motion motion;
    double objective, equality, violation, worst, squares, momentum;  // squares: of the rows' violations, summed
    double *x, *coefficients;               // (size), (columns, joints)
    double *values, *used;                  // (rows, stride), (objective_sums, stride)
    bool differentiated;
    double *gradient, *row;                 // (size): of the objective and of (14)
    double *drift, *attitude, *of_axes;     // (size, stride), (size, stride), (3, joints, axes, stride)
    Index packs, *first, *place;            // differentiated rows: first entry of `values` of each pack, and the inverse
    Index *has_attitude;                    // (stride / 8): whether the attitude's changes are known there
    double *slopes;                         // (packs, size, 8)
    Variables variables;
};

static inline double legendre_tail(const double *tail, const double *values, Index nodes) {
    double most = 0;
    for (int c = 0; c < 3; ++c) most = larger(most, std::fabs(dot(tail + c * nodes, values, nodes)));
    return most;
}

// What is known before a search.
struct Chance {
    bool ends_hold, path_holds, path_is_clear;
};

class Program {
  public:
    Index size, rows, level = -1, stride = 0, evaluations = 0;
    double work = 0, back_off;
    bool watches = true;  // whether rows count

    Program(const Robot &robot, const Constraints &constraints, const Motions &motions, const Nodes *levels,
            const Settings &settings, const Exchange &rules, const Attempt &attempt)
        : size(motions.size), rows(attempt.rows), back_off(rules.back_off), robot(robot), constraints(constraints),
          motions(motions), levels(levels), settings(settings), rules(rules), attempt(attempt), n(robot.joints),
          free(motions.first[robot.joints]) {}

    void lay_out(Arena &arena, Index most_nodes) {
        const Index most = (most_nodes + rules.most_instants + 7) / 8 * 8;
        for (Evaluated *each : {&two[0], &two[1]}) {
            lay_out_motion(arena, each->motion, robot, constraints.capsules, most);
            for (double **some : {&each->x, &each->gradient, &each->row}) arena.take(*some, size);
            arena.take(each->coefficients, motions.columns * n);
            arena.take(each->values, rows * most);
            arena.take(each->used, attempt.objective_sums * most);
            for (double **some : {&each->drift, &each->attitude}) arena.take(*some, size * most);
            arena.take(each->of_axes, 3 * n * motions.axes * most);
            for (Index **some : {&each->first, &each->place}) arena.take(*some, rows * most / 8);
            arena.take(each->has_attitude, most / 8);
            arena.take(each->slopes, rows * most * size);
        }
        for (double **each : {&value, &first, &second}) arena.take(*each, motions.columns * most);
        arena.take(basis, 3 * size * most);
        arena.take(s, most);
        arena.take(own_integrals, most_nodes * most);
        for (double **each : {&outside, &plain}) arena.take(*each, rows * most);
        arena.take(boundary, 2 * n * motions.given);
        arena.take(weights, 8 * (2 + 2 * n + robot.links));
        arena.take(pack, 8 * size);
        arena.take(slope, size);
        arena.take(series, 3 * motions.terms * n + most_nodes + 1);
        arena.take(written, 2 * motions.terms * n);
        between.lay_out(arena, robot, constraints, attempt.minima.instants);
    }

    Evaluated two[2] = {};

    Index nodes() const { return levels[level].nodes; }
    Index instants() const { return count; }
    double instant(Index k) const { return s[k]; }

    // Takes the nodes of a level, and other instants, rising, beside them.
    void watch(Index wanted, const double *others, Index extra) {
        const Nodes &grid = levels[wanted];
        const Index N = grid.nodes, columns = motions.columns;
        level = wanted, count = N + extra;
        stride = (count + 7) / 8 * 8;
        copy(s, grid.s, N);
        copy(s + N, others, extra);
        zero(s + count, stride - count);
        const double *from[3] = {grid.value, grid.first, grid.second};
        double *to[3] = {value, first, second};
        for (int order = 0; order < 3; ++order)
            for (Index c = 0; c < columns; ++c) copy(to[order] + c * stride, from[order] + c * N, N);
        integrals = grid.integrals;
        if (extra && needs_integrals()) {
            for (Index j = 0; j < N; ++j) copy(own_integrals + j * stride, grid.integrals + j * N, N);
            integrals = own_integrals;
        }
        for (Index k = N; k < stride; k += LANES) add_instants(k, grid);
        has_basis = false;
        if (watches) find_outside();
        for (Evaluated &each : two) {
            each.motion.instants = each.motion.stride = stride;  // beyond those asked for at takeoff
            each.motion.per_second = 1 / motions.duration;
            for (Index k = 0; k < stride; ++k) each.motion.time[k] = motions.duration * s[k];
            each.variables = {size, stride, basis, motions.first, motions.axis, nullptr};
        }
    }

    // Values at each.x.
    void evaluate(Evaluated &at) {
        move(at);
        move_links(at);
        if (watches) evaluate_rows(at);
        at.objective = objective(at);
        at.differentiated = false;
        ++evaluations;
        work += rules.evaluation + count * attempt.bodies;
    }

    // The squared violations at at.x; of (14) and some rows alone where these are enough.
    double squares(Evaluated &at, double enough) {
        move(at);
        const double missed = at.equality * at.equality;
        if (missed >= enough) return missed;
        move_links(at);
        evaluate_rows(at, enough - missed);
        return missed + at.squares;
    }

    // Gradient and (14) by x.
    void differentiate(Evaluated &at) {
        if (at.differentiated) return;
        at.differentiated = true;
        const Nodes &grid = levels[level];
        if (!has_basis) combine_basis();
        differentiate_turn(robot, at.motion);
        if (motions.start.knots || motions.goal.knots) follow_axes(at);
        for (Index k = 0; k < grid.nodes; k += LANES) chain_rate(at.variables, at.motion, n, k, at.drift, stride);
        for (Index c = 0; c < size; ++c)
            at.row[c] = motions.duration * dot(grid.weights, at.drift + c * stride, grid.nodes);
        differentiate_objective(at, nullptr);
        at.packs = 0;
        if (!watches || !rows) return;
        std::fill(at.has_attitude, at.has_attitude + stride / 8, 0);
        for (Index number = 0; number < rows * stride / 8; ++number) at.place[number] = -1;
        work += rules.differentiation + rules.entry * count * size * attempt.entries;
    }

    // Rows that are below so much.
    void differentiate_rows(Evaluated &at, double reach) {
        for (Index entry = 0; watches && entry < rows * stride; entry += LANES)
            if (at.place[entry / 8] < 0 && any(load(at.values + entry) < all(reach))) pack_of(at, entry);
    }

    // Derivatives (size, 8) of the 8 entries of the values about one.
    const double *pack_of(Evaluated &at, Index entry) {
        Index &place = at.place[entry / 8];
        if (place >= 0) return at.slopes + place * size * 8;
        const Index row = entry / stride, begin = entry % stride / 8 * 8;
        double *slopes = at.slopes + at.packs * size * 8;
        if (constraints.kind[row] > share_row && !at.has_attitude[begin / 8]++)
            for (Index c = 0; c < size; ++c)
                integrate(at.drift + c * stride, 0, at.attitude + c * stride, begin, begin + 8);
        for (Index k = begin; k < begin + 8; k += LANES)
            differentiate_row(robot, constraints, at.motion, at.variables, row, k, at.attitude + k, stride, slopes);
        at.first[at.packs] = entry / 8 * 8;
        place = at.packs++;
        return slopes;
    }

    // Adds the derivatives (size) of one entry of the values, times a factor.
    void add_slopes(Evaluated &at, Index entry, double factor, double *result) {
        const double *slopes = pack_of(at, entry) + entry % 8;
        for (Index c = 0; c < size; ++c) result[c] += factor * slopes[8 * c];
    }

    // A positive definite first guess (size, size) of the Lagrangian's Hessian.
    void guess_hessian(Evaluated &at, double *hessian) {
        differentiate(at);
        zero(hessian, size * size);
        if (!attempt.objective_sums && !motions.map) {
            for (Index a = 0; a < size; ++a) hessian[a * size + a] = 1;
            return;
        }
        differentiate_objective(at, hessian);
        double most = 0;
        for (Index a = 0; a < size; ++a) most = larger(most, hessian[a * size + a]);
        const double least = attempt.objective_sums ? rules.least_curvature * larger(most, rules.least_curvature) : 0;
        for (Index a = 0; a < size; ++a) hessian[a * size + a] += motions.map ? a >= free : least;
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

    double unresolved(const Evaluated &at) {
        const Nodes &grid = levels[level];
        fastest = 0;
        for (Index k = 0; k < grid.nodes; ++k) fastest = larger(fastest, std::fabs(at.motion.rate[k]));
        return legendre_tail(grid.tail, at.motion.rate, grid.nodes) / larger(fastest, 1e-300);
    }

    // Level at which theta0(T) is exact to an error, see PlanarBaseMotion.level_needed().
    Index level_needed(const Evaluated &at, double error) {
        const double tail = smaller(larger(unresolved(at), settings.smallest_tail), settings.largest_tail);
        return level_of_tail(tail, nodes(), error, fastest * motions.duration, settings.levels,
                             [&](Index candidate) { return levels[candidate].nodes; });
    }

    // Local minima of the rows over the whole motion.
    void look(const Evaluated &at, Minima &minima) {
        minima.found = 0;
        if (!rows) return;
        find_minima(robot, constraints, series_of(at), minima, between);
        work += rules.evaluation * (1 + minima.found) + (minima.instants + minima.looked) * attempt.bodies;
    }

    // Whether rows hold at takeoff and landing that x does not change there; whether the CM is never deeper in an obstacle
    // than the point of the robot that stays nearest to it can be away from it: at some instants, and at all times, as far
    // as its speed, which is largest at an end, tells.
    Chance chance(const Evaluated &at) {
        const Minima &minima = attempt.minima;
        const Series whole = series_of(at);
        const double ends[LANES] = {0, 1};
        between.close.per_second = 1 / whole.duration;
        follow(robot, constraints, whole, ends, LANES, between.close);
        if (constraints.needs_places) {
            between.close.attitude[1] = motions.orientation + motions.change;  // at the goal, wherever x leads
            place(robot, constraints, between.close, 0, 0);
        }
        const double *path = constraints.path;
        Chance found{true, true, true};
        for (Index row = 0; row < rows; ++row) {
            double value[LANES];
            row_values(robot, constraints, between.close, row, 0, LANES, value);
            for (Index end = 0; end < 2 && !attempt.at_ends[row]; ++end)
                if (end >= attempt.low[row] && end <= attempt.high[row])
                    found.ends_hold &= !(value[end] < -attempt.tolerance[row]);
            const Index kind = constraints.kind[row], second = constraints.second[row];
            if (kind <= share_row || kind == pair_row || (row && second == constraints.second[row - 1])) continue;
            const double *obstacle = constraints.obstacles + 7 * second;
            const double across = path[2] - obstacle[4], up = path[3] - obstacle[5];
            const double down = up - path[4] * whole.duration;
            const double way = std::hypot(across, larger(std::fabs(up), std::fabs(down))) * whole.duration;
            for (Index k = 0; k < minima.instants; ++k) {
                const double s = minima.grid[k], t = s * whole.duration, before = k ? minima.grid[k - 1] : s;
                const Place com{all(path[0] + path[2] * t), all(path[1] + path[3] * t - path[4] / 2 * t * t)};
                const double distance = to_obstacle(kind, obstacle, all(t), com, com).distance[0] - obstacle[6];
                const double room = distance - constraints.least[row] + attempt.reach;
                if (s >= attempt.low[row] && s <= attempt.high[row]) found.path_holds &= !(room < 0);
                found.path_is_clear &= room >= way * (s - before);
            }
        }
        return found;
    }

  private:
    Series series_of(const Evaluated &at) {
        const Index terms = motions.terms, N = nodes();
        for (int order = 0; order < 3; ++order)
            multiply(motions.series + order * terms * motions.columns, terms, motions.columns, at.coefficients, n,
                     series + order * terms * n);
        double *turned = series + 3 * terms * n;
        for (Index c = 0; c <= N; ++c)
            turned[c] = motions.duration * dot(levels[level].antiderivative + c * N, at.motion.rate, N);
        turned[0] += motions.orientation;
        return {terms, N + 1, motions.duration, at.momentum, series, series + terms * n, series + 2 * terms * n, turned,
                motions.centre, motions.amplitude};
    }

    const Robot &robot;
    const Constraints &constraints;
    const Motions &motions;
    const Nodes *levels;
    const Settings &settings;
    const Exchange &rules;
    const Attempt &attempt;
    Index n, free, count = 0;
    double fastest = 0;
    bool has_basis = false;
    double *value, *first, *second, *basis, *s, *own_integrals, *outside, *plain, *boundary, *weights, *pack;
    double *slope, *series, *written;
    const double *integrals;  // (nodes, stride)
    MinimaRoom between;

    bool needs_integrals() const { return constraints.needs_places && watches; }

    // Joints and base, and by how much (14) is missed.
    void move(Evaluated &at) {
        place_coefficients(at);
        combine(at.motion, n, at.coefficients, motions.columns, value, first, second);
        swing_joints(robot, at.motion, motions.centre, motions.amplitude);
        turn(robot, at.motion, at.momentum);
        const Nodes &grid = levels[level];
        at.equality = motions.duration * dot(grid.weights, at.motion.rate, grid.nodes) - motions.change;
        at.violation = at.worst = std::fabs(at.equality);
        at.squares = 0;
    }

    // What the rows and the objective need beside.
    void move_links(Evaluated &at) {
        Motion &m = at.motion;
        if (constraints.needs_moments && (watches || attempt.objective_sums)) move_bodies(robot, m);
        if (!needs_integrals()) return;
        integrate(m.rate, motions.orientation, m.attitude, 0, stride);
        place(robot, constraints, m, 0, 0);
    }

    // What rates at the nodes turn until the instants from k to another; some at once, as each sum waits for itself.
    void integrate(const double *rates, double begin, double *turned, Index k, Index end) const {
        auto next = [&](auto together) {
            Vector sums[together.value] = {};
            for (Index j = 0; j < nodes(); ++j)
                for (int each = 0; each < together.value; ++each)
                    sums[each] = add_product(rates[j], load(integrals + j * stride + k + each * LANES), sums[each]);
            for (Vector sum : sums) {
                store(turned + k, all(begin) + all(motions.duration) * sum);
                k += LANES;
            }
        };
        while (k + 4 * LANES <= end) next(std::integral_constant<int, 4>());
        while (k < end) next(std::integral_constant<int, 1>());
    }

    // What instants beside the nodes need: the basis there, and integrals until then.
    void add_instants(Index k, const Nodes &grid) {
        const Index N = grid.nodes, columns = motions.columns, terms = motions.terms;
        double *to[3] = {value, first, second};
        const Vector at = load(s + k);
        for (int order = 0; order < 3; ++order)
            chebyshev_sums(motions.series + order * terms * columns, terms, columns, at, stride, to[order] + k);
        if (needs_integrals()) chebyshev_sums(grid.antiderivative, N + 1, N, at, stride, own_integrals + k);
    }

    // Infinite where a row does not apply, else 0.
    void find_outside() {
        for (Index row = 0; row < rows; ++row)
            for (Index k = 0; k < stride; k += LANES) {
                const Vector at = load(s + k);
                Bits applies = (at >= all(attempt.low[row])) & (at <= all(attempt.high[row]));
                if (!attempt.at_ends[row]) applies &= (at > all(rules.given)) & (at < all(1 - rules.given));
                store(outside + row * stride + k, select(applies, all(0), all(HUGE_VAL)));
            }
        for (Index row = 0; row < rows; ++row)
            for (Index k = count; k < stride; ++k) outside[row * stride + k] = HUGE_VAL;
    }

    // The basis of p as x combine it, joint by joint.
    void combine_basis() {
        const double *of_columns[3] = {value, first, second};
        has_basis = true;
        zero(basis, 3 * size * stride);
        for (int order = 0; order < 3; ++order)
            for (Index i = 0; i < n; ++i) {
                const Index begin = motions.first[i], end = motions.first[i + 1];
                for (Index r = begin; r < end; ++r)
                    for (Index c = begin; c < end; ++c)
                        add(motions.scaling[r * free + c], of_columns[order] + (motions.given + r - begin) * stride,
                            stride, basis + (order * size + c) * stride);
            }
    }

    // Conditions (13) that follow h: p' and p'' at one end, and by how much they change with it.
    void follow_end(const End &end, Index place, double momentum, bool slopes) {
        if (!end.knots) return;
        Index piece = 0;
        while (piece + 2 < end.knots && momentum > end.momenta[piece + 1]) ++piece;
        const double width = end.momenta[piece + 1] - end.momenta[piece];
        const Index of_rate = motions.condition[place + 1], of_curvature = motions.condition[place + 2];
        for (Index i = 0; i < n; ++i) {
            const double at = end.rates[piece * n + i], slope = (end.rates[(piece + 1) * n + i] - at) / width;
            const double rate = at + slope * (momentum - end.momenta[piece]);
            double *to = boundary + (slopes * n + i) * motions.given;
            to[of_rate] = slopes ? slope : rate;
            if (of_curvature >= 0)
                to[of_curvature] = slopes ? 2 * end.bend[i] * rate * slope : end.curvature[i] + end.bend[i] * rate * rate;
        }
    }

    // Coefficients of the basis, and h.
    void place_coefficients(Evaluated &at) {
        at.momentum = motions.momentum + dot(motions.axis, at.x + free, motions.axes);
        copy(boundary, motions.boundary, n * motions.given);
        follow_end(motions.start, 0, at.momentum, false);
        follow_end(motions.goal, 3, at.momentum, false);
        zero(at.coefficients, motions.columns * n);
        for (Index i = 0; i < n; ++i) {
            const Index begin = motions.first[i], end = motions.first[i + 1];
            for (Index c = 0; c < motions.given; ++c) at.coefficients[c * n + i] = boundary[i * motions.given + c];
            for (Index r = begin; r < end; ++r)
                at.coefficients[(motions.given + r - begin) * n + i] =
                    motions.offset[r] + dot(motions.scaling + r * free + begin, at.x + begin, end - begin);
        }
    }

    // By how much p and its derivatives at all instants, and the conditions themselves, change with the axis of h.
    void follow_axes(Evaluated &at) {
        double *by = boundary + n * motions.given;
        zero(by, n * motions.given);
        follow_end(motions.start, 0, at.momentum, true);
        follow_end(motions.goal, 3, at.momentum, true);
        for (Index e = 0; e < n * motions.given; ++e) by[e] *= motions.axis[0];
        const double *columns[3] = {value, first, second};
        zero(at.of_axes, 3 * n * stride);
        for (int order = 0; order < 3; ++order)
            for (Index i = 0; i < n; ++i)
                for (Index c = 0; c < motions.given; ++c)
                    add(by[i * motions.given + c], columns[order] + c * stride, stride,
                        at.of_axes + (order * n + i) * stride);
        at.variables.of_axes = at.of_axes;
    }

    // Values of all rows, and by how much they are violated; of the first rows alone where their squares are enough.
    void evaluate_rows(Evaluated &at, double enough = HUGE_VAL) {
        const Vector none = all(0), inside = all(back_off);
        Vector violation = none, squares = none, worst = none;
        for (Index row = 0; row < rows && !(sum(squares) > enough); ++row) {
            next_values(robot, constraints, at.motion, row, plain);
            for (Index k = 0; k < stride; k += LANES) {
                const Index entry = row * stride + k;
                const Vector value = load(plain + entry) - inside + load(outside + entry);
                const Vector lacks = select(value < none, -value, none);
                store(at.values + entry, value);
                violation += lacks;
                squares = multiply_add(lacks, lacks, squares);
                worst = larger(lacks, worst);
            }
        }
        at.violation += sum(violation);
        at.squares = sum(squares);
        at.worst = larger(at.worst, largest(worst));
    }

    double objective(const Evaluated &at) {
        if (!attempt.objective_sums && !motions.map) return dot(at.x, at.x, free) / 2;
        if (!attempt.objective_sums) {
            multiply(motions.map, motions.terms, motions.columns, at.coefficients, n, written);
            return dot(written, written, motions.terms * n) / 2;
        }
        Vector total = all(0);
        for (Index number = 0; number < attempt.objective_sums; ++number) {
            double *used = at.used + number * stride;
            sum_values(robot, constraints, at.motion, attempt.objective_sum + number, 0, nodes(), used);
            for (Index k = 0; k < nodes(); k += LANES)
                total = multiply_add(load(levels[level].weights + k) * load(used + k), load(used + k), total);
        }
        return motions.duration / attempt.objective_scale * sum(total);
    }

    // Its gradient; or its Hessian, by Gauss and Newton, added.
    void differentiate_objective(Evaluated &at, double *hessian) {
        if (!hessian) zero(at.gradient, size);
        if (!attempt.objective_sums && !motions.map) return copy(at.gradient, at.x, free);
        if (!attempt.objective_sums) return differentiate_written(at, hessian);
        const Index terms = 2 + 2 * n + robot.links, orders = constraints.needs_accelerations ? 2 : 1;
        const Vector scale = all(2 * motions.duration / attempt.objective_scale);
        Vector *of_terms = (Vector *)weights;
        auto add_slopes = [&](Index k) {
            differentiate_sum(robot, at.motion, k, of_terms, constraints.needs_moments);
            chain(at.variables, at.motion, n, k, orders, pack, 8);
        };
        if (!hessian) zero(pack, 8 * size);
        for (Index k = 0; k < nodes(); k += LANES) {
            const Vector weight = scale * load(levels[level].weights + k);
            for (Index term = 0; term < terms; ++term) of_terms[term] = all(0);
            for (Index number = 0; number < attempt.objective_sums; ++number) {
                const Index which = attempt.objective_sum + number;
                const double *own = constraints.sums + which * terms;
                if (!hessian) {
                    const Vector used = weight * load(at.used + number * stride + k);
                    for (Index term = 0; term < terms; ++term)
                        of_terms[term] = add_product(own[term], used, of_terms[term]);
                    continue;
                }
                for (Index term = 0; term < terms; ++term) of_terms[term] = all(own[term]);
                zero(pack, 8 * size);
                add_slopes(k);
                add_normals(weight, hessian);
            }
            if (!hessian) add_slopes(k);
        }
        for (Index c = 0; !hessian && c < size; ++c) at.gradient[c] = sum(load(pack + 8 * c));
    }

    // Squares of the derivatives at the instants that are computed at once, times weights.
    void add_normals(Vector weight, double *hessian) const {
        for (Index a = 0; a < size; ++a)
            for (Index b = 0; b <= a; ++b) {
                const double part = sum(weight * load(pack + 8 * a) * load(pack + 8 * b));
                hessian[a * size + b] += part;
                if (b < a) hessian[b * size + a] += part;
            }
    }

    // Of |b|^2 / 2 where the conditions follow h.
    void differentiate_written(Evaluated &at, double *hessian) {
        const double *by_axis = boundary + n * motions.given;
        double *b = written + motions.terms * n;
        multiply(motions.map, motions.terms, motions.columns, at.coefficients, n, b);
        for (Index term = 0; term < motions.terms; ++term)
            for (Index i = 0; i < n; ++i) {
                const double *map = motions.map + term * motions.columns;
                const Index begin = motions.first[i], end = motions.first[i + 1];
                zero(slope, size);
                for (Index r = begin; r < end; ++r)
                    add(map[motions.given + r - begin], motions.scaling + r * free + begin, end - begin, slope + begin);
                slope[free] = dot(map, by_axis + i * motions.given, motions.given);
                if (!hessian) add(b[term * n + i], slope, size, at.gradient);
                for (Index a = 0; hessian && a < size; ++a) add(slope[a], slope, size, hessian + a * size);
            }
    }
};
