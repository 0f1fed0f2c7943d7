// A flight with its rows of constraints as a nonlinear program, FlightProgram of planning/transcription/program.py: at
// the nodes of a level and at other instants, minimise an objective subject to (14) and to the rows, a little inside.

// Values (instants) are those of rows at instants, row by row; where a row does not apply they are infinite.
struct Evaluated {
    Motion motion;
    double objective, equality, violation, worst, squares, momentum;  // squares: of the rows' violations, summed
    double *x, *coefficients;               // (size), (columns, joints)
    double *values;                         // (rows, stride)
    bool differentiated;
    double *gradient, *row;                 // (size): of the objective and of (14)
    double *drift, *attitude, *of_axes;     // (nodes, size), (instants, size), (3, instants, joints)
    Index *has_attitude;                    // (instants)
    Index near, *entry, *place;             // differentiated rows: which entry of `values` each is, and the inverse
    double *slopes;                         // (near, size)
    Variables variables;
};

static inline double legendre_tail(const double *tail, const double *values, Index nodes) {
    double most = 0;
    for (int c = 0; c < 3; ++c) most = larger(most, std::fabs(dot(tail + c * nodes, values, nodes)));
    return most;
}

class Program {
  public:
    Index size, rows, level = -1, stride = 0, evaluations = 0;
    double work = 0;
    bool watches = true;  // whether rows count

    Program(const Robot &robot, const Constraints &constraints, const Motions &motions, const Nodes *levels,
            const Settings &settings, const Exchange &rules, const Attempt &attempt)
        : size(motions.size), rows(attempt.rows), robot(robot), constraints(constraints), motions(motions),
          levels(levels), settings(settings), rules(rules), attempt(attempt), n(robot.joints),
          free(motions.first[robot.joints]) {}

    void lay_out(Arena &arena, Index most_nodes) {
        const Index most = (most_nodes + rules.most_instants + 7) / 8 * 8;
        for (Evaluated *each : {&two[0], &two[1]}) {
            lay_out_motion(arena, each->motion, robot, constraints.capsules, most);
            for (double **some : {&each->x, &each->gradient, &each->row}) arena.take(*some, size);
            arena.take(each->coefficients, motions.columns * n);
            arena.take(each->values, rows * most);
            arena.take(each->drift, most_nodes * size);
            arena.take(each->attitude, most * size);
            arena.take(each->of_axes, 3 * most * n);
            arena.take(each->has_attitude, most);
            for (Index **some : {&each->entry, &each->place}) arena.take(*some, rows * most);
            arena.take(each->slopes, rows * most * size);
        }
        for (double **each : {&value, &first, &second}) arena.take(*each, motions.columns * most);
        arena.take(basis, 3 * most * size);
        for (double **each : {&s, &times}) arena.take(*each, most);
        arena.take(integrals, most * most_nodes);
        arena.take(until, most_nodes);
        arena.take(boundary, 2 * n * motions.given);
        arena.take(weights, 2 + 2 * n + robot.links);
        arena.take(slope, size);
        arena.take(series, 3 * motions.terms * n + most_nodes + 1);
        arena.take(written, 2 * motions.terms * n);
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
        for (Index k = 0; k < stride; ++k) times[k] = k < count ? motions.duration * s[k] : 0;
        const double *from[3] = {grid.value, grid.first, grid.second};
        double *to[3] = {value, first, second};
        for (int order = 0; order < 3; ++order)
            for (Index c = 0; c < columns; ++c) {
                copy(to[order] + c * stride, from[order] + c * N, N);
                zero(to[order] + c * stride + N, stride - N);
            }
        for (Index j = 0; constraints.needs_places && j < N; ++j)
            copy(integrals + j * stride, grid.integrals + j * N, N);
        for (Index k = N; k < count; ++k) add_instant(k, grid);
        combine_basis(to);
        for (Evaluated &each : two) {
            each.motion.instants = count, each.motion.stride = stride;
            each.motion.per_second = 1 / motions.duration;
            each.variables = {size, count, basis, motions.first, motions.axis, nullptr};
        }
    }

    // Values at each.x.
    void evaluate(Evaluated &at) {
        Motion &m = at.motion;
        const Nodes &grid = levels[level];
        place_coefficients(at);
        combine(m, n, at.coefficients, motions.columns, value, first, second);
        swing_joints(robot, m, motions.centre, motions.amplitude);
        turn(robot, m, at.momentum);
        at.equality = motions.duration * dot(grid.weights, m.rate, grid.nodes) - motions.change;
        if (constraints.needs_moments && (watches || attempt.objective_sums)) move_bodies(robot, m);
        if (constraints.needs_places && watches) {
            copy(m.time, times, stride);
            zero(m.attitude, stride);
            for (Index j = 0; j < grid.nodes; ++j) add(m.rate[j], integrals + j * stride, count, m.attitude);
            for (Index k = 0; k < count; ++k)
                m.attitude[k] = motions.orientation + motions.duration * m.attitude[k];
            place(robot, constraints, m, 0, 0);
        }
        at.violation = at.worst = std::fabs(at.equality);
        at.squares = 0;
        for (Index row = 0; watches && row < rows; ++row) evaluate_row(at, row);
        at.objective = objective(at);
        at.differentiated = false;
        ++evaluations;
        work += rules.evaluation + count * attempt.bodies;
    }

    // Gradient, (14) and the rows that a step may reach, by x.
    void differentiate(Evaluated &at) {
        if (at.differentiated) return;
        at.differentiated = true;
        const Nodes &grid = levels[level];
        differentiate_turn(robot, at.motion);
        if (motions.start.knots || motions.goal.knots) follow_axes(at);
        zero(at.row, size);
        zero(at.drift, grid.nodes * size);
        for (Index k = 0; k < grid.nodes; ++k) {
            chain_rate(at.variables, at.motion, n, k, at.drift + k * size);
            add(motions.duration * grid.weights[k], at.drift + k * size, size, at.row);
        }
        differentiate_objective(at, nullptr);
        at.near = 0;
        if (!watches || !rows) return;
        std::memset(at.has_attitude, 0, count * sizeof(Index));
        for (Index entry = 0; entry < rows * stride; ++entry) at.place[entry] = -1;
        for (Index entry = 0; entry < rows * stride; ++entry)
            if (at.values[entry] < rules.reach) slopes_of(at, entry);
        work += rules.differentiation + rules.entry * count * size * attempt.entries;
    }

    // Derivatives (size) of one entry of the values.
    const double *slopes_of(Evaluated &at, Index entry) {
        if (at.place[entry] >= 0) return at.slopes + at.place[entry] * size;
        const Index row = entry / stride, k = entry % stride;
        double *slopes = at.slopes + at.near * size, *attitude = at.attitude + k * size;
        if (constraints.kind[row] > share_row && !at.has_attitude[k]) {
            const Nodes &grid = levels[level];
            zero(attitude, size);
            for (Index j = 0; j < grid.nodes; ++j)
                add(motions.duration * integrals[j * stride + k], at.drift + j * size, size, attitude);
            at.has_attitude[k] = 1;
        }
        differentiate_row(robot, constraints, at.motion, at.variables, row, k, attitude, slopes);
        at.entry[at.near] = entry;
        at.place[entry] = at.near++;
        return slopes;
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

    // Local minima of the rows over the whole motion; 1 without memory.
    Index look(const Evaluated &at, Minima &minima) {
        const Index terms = motions.terms, N = nodes();
        for (int order = 0; order < 3; ++order)
            multiply(motions.series + order * terms * motions.columns, terms, motions.columns, at.coefficients, n,
                     series + order * terms * n);
        double *turned = series + 3 * terms * n;
        for (Index c = 0; c <= N; ++c)
            turned[c] = motions.duration * dot(levels[level].antiderivative + c * N, at.motion.rate, N);
        turned[0] += motions.orientation;
        const Series whole{terms, N + 1, motions.duration, at.momentum, series, series + terms * n,
                           series + 2 * terms * n, turned, motions.centre, motions.amplitude};
        const Index failed = find_minima(robot, constraints, whole, minima);
        work += rules.evaluation * (1 + minima.found) + (minima.instants + minima.looked) * attempt.bodies;
        return failed;
    }

  private:
    const Robot &robot;
    const Constraints &constraints;
    const Motions &motions;
    const Nodes *levels;
    const Settings &settings;
    const Exchange &rules;
    const Attempt &attempt;
    Index n, free, count = 0;
    double fastest = 0;
    double *value, *first, *second, *basis, *s, *times, *integrals, *until, *boundary, *weights;
    double *slope, *series, *written;

    // What an instant beside the nodes needs: the basis there, and integrals until then.
    void add_instant(Index k, const Nodes &grid) {
        const Index N = grid.nodes, columns = motions.columns, terms = motions.terms;
        double *to[3] = {value, first, second};
        for (int order = 0; order < 3; ++order)
            chebyshev_sums(motions.series + order * terms * columns, terms, columns, s[k], stride, to[order] + k);
        if (!constraints.needs_places) return;
        const double x = 2 * s[k] - 1;
        double before = 1, now = x;
        zero(until, N);
        for (Index c = 0; c <= N; ++c) {
            add(before, grid.antiderivative + c * N, N, until);
            const double next = 2 * x * now - before;
            before = now, now = next;
        }
        for (Index j = 0; j < N; ++j) integrals[j * stride + k] = until[j];
    }

    // The basis of p as x combine it, joint by joint.
    void combine_basis(double **of_columns) {
        zero(basis, 3 * count * size);
        for (int order = 0; order < 3; ++order)
            for (Index i = 0; i < n; ++i) {
                const Index begin = motions.first[i], end = motions.first[i + 1];
                for (Index r = begin; r < end; ++r) {
                    const double *column = of_columns[order] + (motions.given + r - begin) * stride;
                    const double *scaling = motions.scaling + r * free;
                    for (Index k = 0; k < count; ++k)
                        add(column[k], scaling + begin, end - begin, basis + (order * count + k) * size + begin);
                }
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
        for (int order = 0; order < 3; ++order)
            for (Index k = 0; k < count; ++k)
                for (Index i = 0; i < n; ++i) {
                    double sum = 0;
                    for (Index c = 0; c < motions.given; ++c)
                        sum += columns[order][c * stride + k] * by[i * motions.given + c];
                    at.of_axes[(order * count + k) * n + i] = sum;
                }
        at.variables.of_axes = at.of_axes;
    }

    void evaluate_row(Evaluated &at, Index row) {
        double *values = at.values + row * stride;
        auto applies = [&](Index k) {
            const bool moves = attempt.at_ends[row] || (s[k] > rules.given && s[k] < 1 - rules.given);
            return moves && s[k] >= attempt.low[row] && s[k] <= attempt.high[row];
        };
        row_values(robot, constraints, at.motion, row, applies, values);
        for (Index k = 0; k < stride; ++k) {
            if (k >= count || !applies(k)) {
                values[k] = HUGE_VAL;
                continue;
            }
            values[k] -= back_off;
            if (!(values[k] < 0)) continue;
            at.violation -= values[k];
            at.squares += values[k] * values[k];
            at.worst = larger(at.worst, -values[k]);
        }
    }

    double objective(const Evaluated &at) {
        if (!attempt.objective_sums && !motions.map) return dot(at.x, at.x, free) / 2;
        double total = 0;
        if (!attempt.objective_sums) {
            multiply(motions.map, motions.terms, motions.columns, at.coefficients, n, written);
            return dot(written, written, motions.terms * n) / 2;
        }
        for (Index k = 0; k < nodes(); ++k)
            for (Index sum = 0; sum < attempt.objective_sums; ++sum) {
                const double used = sum_at<double>(robot, constraints, at.motion, attempt.objective_sum + sum, k);
                total += levels[level].weights[k] * used * used;
            }
        return motions.duration / attempt.objective_scale * total;
    }

    // Its gradient; or its Hessian, by Gauss and Newton, added.
    void differentiate_objective(Evaluated &at, double *hessian) {
        if (!hessian) zero(at.gradient, size);
        if (!attempt.objective_sums && !motions.map) return copy(at.gradient, at.x, free);
        if (!attempt.objective_sums) return differentiate_written(at, hessian);
        const Index terms = 2 + 2 * n + robot.links, orders = constraints.needs_accelerations ? 2 : 1;
        for (Index k = 0; k < nodes(); ++k) {
            const double weight = 2 * motions.duration / attempt.objective_scale * levels[level].weights[k];
            zero(weights, terms);
            for (Index sum = 0; sum < attempt.objective_sums; ++sum) {
                const double *own = constraints.sums + (attempt.objective_sum + sum) * terms;
                if (!hessian) {
                    add(weight * sum_at<double>(robot, constraints, at.motion, attempt.objective_sum + sum, k), own,
                        terms, weights);
                    continue;
                }
                differentiate_sum(robot, at.motion, k, own, constraints.needs_moments);
                zero(slope, size);
                chain(at.variables, at.motion, n, k, orders, slope);
                for (Index a = 0; a < size; ++a) add(weight * slope[a], slope, size, hessian + a * size);
            }
            if (hessian) continue;
            differentiate_sum(robot, at.motion, k, weights, constraints.needs_moments);
            chain(at.variables, at.motion, n, k, orders, at.gradient);
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

  public:
    double back_off = rules.back_off;
};
