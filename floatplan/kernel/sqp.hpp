// Sequential quadratic programming from one x (Nocedal and Wright, Numerical Optimization, 2nd ed., chapter 18) for
//
//     minimise  f(x)  subject to  c(x) = 0  and  v(x) >= 0,
//
// c being what the attitude at landing lacks, v the rows at all instants. A step d is the solution of
//
//     minimise  f' d + d H d / 2  subject to  c + c' d = 0  and  v + v' d >= 0                                     (18.11)
//
// by the dual method (quadratic.hpp), with a damped BFGS approximation H of the Lagrangian's Hessian (18.14), (18.15), and is
// shortened until the l1 merit function (18.27) falls enough. (18.11) has the rows that a step may reach, which alone are
// differentiated; a row that a step reaches all the same joins them. Where the rows contradict one another the step is elastic
// (elastic.hpp); once they do no more, H is guessed anew. restoration.hpp leaves the objective aside.

// Values of the last iterations, fewer than 8.
struct Progress {
    double values[8];
    Index known = 0;

    // Whether a new one is above a share of that so many iterations before.
    bool stalls(double value, Index iterations, double share) {
        values[known++ % 8] = value;
        return known > iterations && value > share * values[(known - 1 - iterations) % 8];
    }
};

template <typename Flight> class Sqp {
  public:
    using At = Evaluated<Flight>;
    Index iterations = 0;

    Sqp(Program<Flight> &program, const Settings &settings, const Exchange &exchange, const SearchProblem &problem)
        : now(program.two), trial(program.two + 1), program(program), settings(settings), exchange(exchange), problem(problem),
          size(program.size) {}

    void lay_out(Arena &arena, Index most_rows) {
        qp.lay_out(arena, size, most_rows);
        for (double **each : {&hessian, &initial, &matrix, &metric}) arena.take(*each, size * size);
        for (double **each : {&direction, &change, &gradient, &product, &right, &normal}) arena.take(*each, size);
        for (double **each : {&gathered, &linear, &slope, &multipliers, &step_multipliers, &multiplier_of})
            arena.take(*each, most_rows);
        arena.take(squares_of_rows, size * (size + 3) / 2 * 8);
        for (Index **each : {&active, &step_active, &taken}) arena.take(*each, most_rows);
        for (Index **each : {&likely, &likely_row}) arena.take(*each, size + 1);
        arena.take(likely_instant, size + 1);
    }

    At *now, *trial;
    double *hessian;
    bool is_stuck = false;  // the last time that violations were reduced
    double farthest = HUGE_VAL;  // of x: a program of one equality is left where that, were it linear, held farther away

    bool is_exhausted() const { return program.work > problem.most_work; }

    void swap() { std::swap(now, trial); }

    double largest_curvature() const {
        double most = 1;
        for (Index k = 0; k < size; ++k) most = larger(most, hessian[k * size + k]);
        return most;
    }

    // From `now`, with a first approximation in `hessian`; optimal, feasible or infeasible. A search that hardly moves takes
    // that up again, unless it has not moved since.
    Status minimise(const Stage &stage, double longest_step, bool polish) {
        slack_penalty = settings.slack_penalty * largest_curvature();
        copy(initial, hessian, size * size);
        double penalty = 0;
        bool was_reset = true, is_optimal = false;
        Index slow_steps = 0, iteration = 0;
        Progress of_elastic;
        active_count = 0;
        for (double &multiplier : equality_multipliers) multiplier = 0;
        while (size && iteration < stage.iterations && !is_exhausted() && program.is_known(*now)) {
            ++iteration;
            ++iterations;
            program.differentiate(*now);
            if (now->worst > farthest * std::sqrt(dot(now->row, now->row, size))) break;
            const bool was_elastic = elastic && iteration > 1;
            find_step();
            if (was_elastic && !elastic) {  // no approximation has followed it here
                program.guess_hessian(*now, hessian);
                copy(initial, hessian, size * size);
                find_step();
            }
            while (reaches_more(longest_step)) find_step(exchange.begins_with_active && !elastic);
            if (!elastic) {
                of_elastic.known = 0;
            } else if (of_elastic.stalls(now->violation, exchange.stall_iterations, exchange.elastic_stalled) &&
                       now->worst > settings.hopeless) {
                break;
            }
            const double slope = dot(now->gradient, direction, size), squared = dot(direction, direction, size);
            const bool stationary = is_stationary(slope, stage);
            is_optimal = stationary && now->worst <= stage.feasibility;
            if (is_optimal) break;
            const double required = settings.penalty_factor * largest_step_multiplier();
            penalty = larger(required, required + settings.penalty_kept * (penalty - required));
            if (!(squared > 0) || !(required <= settings.largest_multiplier * slack_penalty)) break;
            const double first = smaller(1.0, longest_step / larger(program.metric(direction), 1e-300));
            const Line line = search_line(slope, first, penalty);
            slow_steps = line.used > settings.slow_evaluations ? slow_steps + 1 : 0;
            if (!line.accepted || slow_steps == settings.slow_steps) {
                if (was_reset) break;
                copy(hessian, initial, size * size);
                was_reset = true;
                slow_steps = 0;
                continue;
            }
            swap();
            if (stationary && line.length == 1 && now->worst <= stage.feasibility) {
                is_optimal = true;
                break;
            }
            if (!elastic) update_hessian(line.length);
            was_reset = was_reset && slow_steps > 0;
        }
        if (polish && size) polish_equality(is_optimal);
        return now->worst <= stage.feasibility ? (is_optimal ? optimal : feasible) : infeasible;
    }

    // Least-norm steps on to the equalities, while the violation decreases, all with the same derivatives: those at `now`, or
    // where the last step led to the optimum, those at its begin, from which they hardly differ.
    void polish_equality(bool is_optimal) {
        const Index e = program.equalities;
        if (!(largest_equality(*now) > settings.polished)) return;
        if (!is_optimal) program.differentiate(*now);
        const double *rows = now->differentiated ? now->row : trial->row;
        double gram[MOST * MOST];
        for (Index a = 0; a < e; ++a)
            for (Index b = 0; b < e; ++b) gram[a * e + b] = dot(rows + a * size, rows + b * size, size);
        for (Index used = 0; used < settings.polishing_steps && largest_equality(*now) > settings.polished; ++used) {
            double matrix[MOST * MOST], multipliers[MOST];
            copy(matrix, gram, e * e);
            copy(multipliers, now->equality, e);
            if (!eliminate(matrix, multipliers, e)) return;
            copy(trial->x, now->x, size);
            for (Index a = 0; a < e; ++a) add(-multipliers[a], rows + a * size, size, trial->x);
            program.evaluate(*trial);
            if (!(trial->worst < now->worst)) return;
            swap();
        }
    }

    // restoration.hpp
    double reduce_violations();

    const double *elastic_step(double penalty) {
        slack_penalty = penalty;
        find_elastic_step();
        return direction;
    }

  private:
    static constexpr Index MOST = Flight::most_equalities;

    struct Line {
        bool accepted;
        double length;
        Index used;
    };

    Program<Flight> &program;
    const Settings &settings;
    const Exchange &exchange;
    const SearchProblem &problem;
    Index size;
    DualMethod qp;
    double slack_penalty = 1, violation_left = 0, squares_left = 0;
    double equality_multipliers[MOST] = {}, step_equality_multipliers[MOST] = {};
    bool elastic = false, is_tried = false;  // the latter: whether the trial is where the whole step leads
    double *initial, *matrix, *metric, *direction, *change, *gradient, *product, *right, *normal;
    // Of the differentiated rows: their values, those after a step, and how they change.
    double *squares_of_rows, *gathered, *linear, *slope;
    // Multipliers of the Lagrangian, of entries of the values, and those of the step's quadratic program.
    Index active_count = 0, step_count = 0, *active, *step_active, *taken;
    Index last_count = 0, *likely, *likely_row;  // rows that were active in the last step, and at which instants
    double *likely_instant;
    double *multipliers, *step_multipliers, *multiplier_of;

    double squares(const At &at) const {
        double total = 0;
        for (Index e = 0; e < program.equalities; ++e) total += at.equality[e] * at.equality[e];
        total += at.squares;
        return std::isfinite(total) ? total : HUGE_VAL;
    }

    const double *row_of(Index equality) const { return now->row + equality * size; }

    double largest_equality(const At &at) const {
        double most = 0;
        for (Index e = 0; e < program.equalities; ++e) most = larger(most, std::fabs(at.equality[e]));
        return most;
    }

    Index near() const { return 8 * now->packs; }
    Index entry(Index e) const { return now->first[e / 8] + e % 8; }

    // Values of the differentiated rows of `now`, at another point.
    void gather(const At &at) {
        for (Index pack = 0; pack < now->packs; ++pack) copy(gathered + 8 * pack, at.values + now->first[pack], 8);
    }

    // By how much the differentiated rows change with a step.
    void follow(const double *step, double *changes) const {
        for (Index e = 0; e < near(); e += LANES) {
            const double *slopes = now->slopes + e / 8 * size * 8 + e % 8;
            Vector sum = all(0);
            for (Index k = 0; k < size; ++k) sum = add_product(step[k], load(slopes + 8 * k), sum);
            store(changes + e, sum);
        }
    }

    Quadratic quadratic(const double *by, const double *gradient, const double *equality) {
        return {size, program.equalities, near(), exchange.qp_changes, exchange.qp_tolerance, by, gradient, equality,
                now->row, gathered, now->slopes, 0, nullptr, nullptr};
    }

    // Operations of the dual method: its factors, and what each change of the active rows takes.
    void count_solving() {
        const double factors = static_cast<double>(size) * size * size;
        program.work += exchange.solving * (factors + static_cast<double>(qp.changes) * size * (near() + 3 * size));
    }

    // From the step found last where that is so, and rows have joined since.
    void find_step(bool resumes = false) {
        program.differentiate_rows(*now, exchange.looked_ahead);
        gather(*now);
        violation_left = 0;
        const Quadratic of_step = quadratic(hessian, now->gradient, now->equality);
        const bool solved = resumes ? qp.resume(of_step) : qp.solve(of_step, likely, count_likely());
        elastic = !solved || qp.held < program.equalities;
        count_solving();
        if (elastic) return find_elastic_step();
        copy(direction, qp.x, size);
        for (Index e = 0; e < qp.held; ++e) step_equality_multipliers[e] = -qp.multipliers[e];
        step_count = qp.count - qp.held;
        for (Index k = 0; k < step_count; ++k) {
            step_active[k] = entry(qp.active[k + qp.held]);
            step_multipliers[k] = qp.multipliers[k + qp.held];
        }
        for (Index k = 0; k < step_count; ++k) {
            likely_row[k] = step_active[k] / program.stride;
            likely_instant[k] = program.instant(step_active[k] % program.stride);
        }
        last_count = step_count;
    }

    // Writes which of the differentiated rows are those that were active in the last step, each at the nearest instant.
    Index count_likely() {
        Index found = 0;
        for (Index k = 0; k < last_count && exchange.begins_with_active; ++k) {
            Index nearest = 0;
            for (Index other = 1; other < program.instants(); ++other)
                if (std::fabs(program.instant(other) - likely_instant[k]) <
                    std::fabs(program.instant(nearest) - likely_instant[k]))
                    nearest = other;
            const Index e = likely_row[k] * program.stride + nearest, pack = now->place[e / 8];
            if (pack >= 0) likely[found++] = 8 * pack + e % 8;
        }
        return found;
    }

    // elastic.hpp
    void find_elastic_step();
    void add_violated(double weight);
    double find_lowest(double penalty, const double *lacking);

    // restoration.hpp
    void find_damped_step(double damping);

    // Derivatives (size) of a differentiated row.
    const double *normal_of(Index e) const {
        const double *slopes = now->slopes + e / 8 * size * 8 + e % 8;
        for (Index k = 0; k < size; ++k) normal[k] = slopes[8 * k];
        return normal;
    }

    // Adds a constraint's square to the normal equations, matrix and right, from its derivatives and its value.
    void add_normal(const double *row, double weight, double value) {
        for (Index k = 0; k < size; ++k) add(weight * row[k], row, size, matrix + k * size);
        add(-weight * value, row, size, right);
    }

    double largest_step_multiplier() const {
        double most = 0;
        for (Index e = 0; e < program.equalities; ++e) most = larger(most, std::fabs(step_equality_multipliers[e]));
        for (Index k = 0; k < step_count; ++k) most = larger(most, step_multipliers[k]);
        return most;
    }

    bool is_stationary(double slope, const Stage &stage) const {
        double predicted = 0;
        for (Index e = 0; e < program.equalities; ++e) predicted += step_equality_multipliers[e] * now->equality[e];
        predicted -= slope;
        for (Index k = 0; k < step_count; ++k) predicted -= step_multipliers[k] * now->values[step_active[k]];
        return !elastic && std::fabs(predicted) <= stage.optimality * (1 + std::fabs(now->objective));
    }

    // Backtracks for the l1 merit function; at first with a correction of the second order.
    Line search_line(double slope, double first, double penalty) {
        const double merit = now->objective + penalty * now->violation;
        slope = smaller(slope - penalty * (now->violation - violation_left), 0.0);
        const double rounding = 1e-13 * (1 + std::fabs(merit));
        Line line{false, first, 0};
        auto is_better = [&] {
            ++line.used;
            return trial->objective + penalty * trial->violation - merit <= settings.armijo * line.length * slope + rounding;
        };
        while (line.length > settings.shortest_step * first) {
            for (Index k = 0; k < size; ++k) trial->x[k] = now->x[k] + line.length * direction[k];
            if (line.used || !is_tried) program.evaluate(*trial);
            line.accepted = is_better();
            if (line.accepted) break;
            const double rise = trial->objective + penalty * trial->violation - merit;
            if (line.length == first && program.watches && trial->violation > now->violation && correct()) {
                line.accepted = is_better();
                if (line.accepted) break;
            }
            const double lowest = -slope * line.length / (2 * (rise - slope * line.length));
            line.length *= smaller(settings.shortening[1], larger(settings.shortening[0], lowest));
        }
        return line;
    }

    // Whether the step, were all linear, would violate rows without derivatives, which a look along it tells: they are
    // differentiated. Where the step may be taken whole it is tried first: if they keep enough of their values there, none
    // is reached.
    bool reaches_more(double longest_step) {
        is_tried = false;
        if (!program.watches || !program.rows) return false;
        if (program.metric(direction) <= longest_step) {
            for (Index k = 0; k < size; ++k) trial->x[k] = now->x[k] + direction[k];
            program.evaluate(*trial);
            is_tried = true;
            for (Index e = 0; is_tried && e < program.rows * program.stride; e += LANES)
                is_tried = now->place[e / 8] >= 0 ||
                           !any(load(trial->values + e) < all(exchange.value_kept) * load(now->values + e));
            if (is_tried) return false;
        }
        const double share = 1e-6 / larger(1.0, std::sqrt(dot(direction, direction, size)));
        for (Index k = 0; k < size; ++k) trial->x[k] = now->x[k] + share * direction[k];
        program.evaluate(*trial);
        return reach(share);
    }

    // Differentiates the rows that a step would violate of which the trial is a share; whether there are new ones.
    bool reach(double share) {
        const Index before = now->packs;
        for (Index e = 0; e < program.rows * program.stride; e += LANES) {
            if (now->place[e / 8] >= 0) continue;
            const Vector here = load(now->values + e), there = here + (load(trial->values + e) - here) / all(share);
            if (any(there < all(0))) program.pack_of(*now, e);
        }
        return now->packs > before;
    }

    // Moves the trial by the shortest step back on to the constraints, to first order, with the derivatives before it.
    bool correct() {
        reach(1);
        gather(*trial);
        zero(matrix, size * size);
        for (Index k = 0; k < size; ++k) matrix[k * size + k] = 1;
        zero(right, size);
        const bool solved = qp.solve(quadratic(matrix, right, trial->equality));
        count_solving();
        if (!solved) return false;
        add(1, qp.x, size, trial->x);
        program.evaluate(*trial);
        return true;
    }

    // Multipliers go towards those of the step, as far as the step is taken. Entries that have one before or after are kept.
    void update_multipliers(double length) {
        constexpr double done = -1;  // in place of the step's multiplier, which is never negative
        for (Index e = 0; e < program.equalities; ++e)
            equality_multipliers[e] += length * (step_equality_multipliers[e] - equality_multipliers[e]);
        for (Index k = 0; k < active_count; ++k) multiplier_of[active[k]] = 0;
        for (Index k = 0; k < step_count; ++k) multiplier_of[step_active[k]] = step_multipliers[k];
        Index kept = 0;
        const auto keep = [&](Index entry, double multiplier) {
            active[kept] = entry;
            multipliers[kept++] = multiplier;
        };
        const Index before = active_count;
        for (Index k = 0; k < before; ++k) {
            const Index entry = active[k];
            const double multiplier = multipliers[k] + length * (multiplier_of[entry] - multipliers[k]);
            multiplier_of[entry] = done;
            if (multiplier != 0) keep(entry, multiplier);
        }
        for (Index k = 0; k < step_count; ++k)
            if (multiplier_of[step_active[k]] != done && step_multipliers[k] != 0)
                keep(step_active[k], length * step_multipliers[k]);
        active_count = kept;
    }

    // Damped BFGS, Nocedal and Wright (6.19), (18.14), (18.15), along the step that was accepted.
    void update_hessian(double length) {
        const At &before = *trial;
        update_multipliers(length);
        program.differentiate(*now);
        for (Index k = 0; k < size; ++k) {
            change[k] = now->x[k] - before.x[k];
            gradient[k] = now->gradient[k] - before.gradient[k];
            for (Index e = 0; e < program.equalities; ++e)
                gradient[k] += equality_multipliers[e] * (now->row[e * size + k] - before.row[e * size + k]);
        }
        for (Index k = 0; k < active_count; ++k) {
            program.add_slopes(*now, active[k], -multipliers[k], gradient);
            program.add_slopes(*trial, active[k], multipliers[k], gradient);
        }
        multiply_vector(hessian, size, size, size, change, product);
        const double approximated = dot(change, product, size);
        double measured = dot(change, gradient, size);
        if (approximated < 1e-20) return;
        if (measured < settings.damping * approximated) {
            const double damping = (1 - settings.damping) * approximated / (approximated - measured);
            for (Index k = 0; k < size; ++k) gradient[k] = damping * gradient[k] + (1 - damping) * product[k];
            measured = dot(change, gradient, size);
        }
        if (!(dot(gradient, gradient, size) < settings.largest_curvature * slack_penalty * measured))
            return copy(hessian, initial, size * size);
        for (Index k = 0; k < size; ++k) {
            add(gradient[k] / measured, gradient, size, hessian + k * size);
            add(-product[k] / approximated, product, size, hessian + k * size);
        }
    }
};
