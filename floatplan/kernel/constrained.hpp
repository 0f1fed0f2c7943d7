// Sequential quadratic programming from one point, with a damped BFGS approximation of the Lagrangian's Hessian. Each
// quadratic program has the rows that a step may reach. A row that a step reaches all the same joins them. Where the rows
// contradict one another the steps are elastic; once they do no more, the Hessian is guessed anew.

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

template <typename Flight> class Constrained {
  public:
    using At = Evaluated<Flight>;
    Index iterations = 0;

    Constrained(Program<Flight> &program, const Settings &settings, const Exchange &rules, const Attempt &attempt)
        : now(program.two), trial(program.two + 1), program(program), set(settings), rules(rules), attempt(attempt),
          size(program.size) {}

    void lay_out(Arena &arena, Index most_rows) {
        qp.lay_out(arena, size, most_rows);
        for (double **each : {&hessian, &initial, &matrix, &metric}) arena.take(*each, size * size);
        for (double **each : {&direction, &change, &gradient, &product, &right, &normal}) arena.take(*each, size);
        for (double **each : {&gathered, &linear, &slope, &pulls, &step_pulls, &pull_of}) arena.take(*each, most_rows);
        arena.take(squares_of_rows, size * (size + 3) / 2 * 8);
        for (Index **each : {&pulled, &pulling, &taken}) arena.take(*each, most_rows);
    }

    At *now, *trial;
    double *hessian;
    bool is_stuck = false;  // the last time that violations were reduced
    double farthest = HUGE_VAL;  // of x: a program of one equality is left where that, were it linear, held farther away

    bool is_exhausted() const { return program.work > attempt.most_work; }

    void swap() { std::swap(now, trial); }

    double largest_curvature() const {
        double most = 1;
        for (Index k = 0; k < size; ++k) most = larger(most, hessian[k * size + k]);
        return most;
    }

    // From `now`, with a first approximation in `hessian`; optimal, feasible or infeasible.
    Status minimise(const Stage &stage, double longest_step, bool polish) {
        slack_penalty = set.slack_penalty * largest_curvature();
        copy(initial, hessian, size * size);
        double penalty = 0;
        bool was_reset = true, is_optimal = false;
        Index slow_steps = 0, iteration = 0;
        Progress of_elastic;
        pull_count = 0;
        for (double &pull : equality_pulls) pull = 0;
        while (size && iteration < stage.iterations && !is_exhausted() && program.is_known(*now)) {
            ++iteration, ++iterations;
            program.differentiate(*now);
            if (now->worst > farthest * std::sqrt(dot(now->row, now->row, size))) break;
            const bool was_elastic = elastic && iteration > 1;
            find_step();
            if (was_elastic && !elastic) {  // no approximation has followed it here
                program.guess_hessian(*now, hessian);
                copy(initial, hessian, size * size);
                find_step();
            }
            while (reaches_more(longest_step)) find_step();
            if (!elastic) of_elastic.known = 0;
            else if (of_elastic.stalls(now->violation, rules.stall_iterations, rules.elastic_stalled) &&
                     now->worst > set.hopeless)
                break;
            const double slope = dot(now->gradient, direction, size), squared = dot(direction, direction, size);
            const bool stationary = is_stationary(slope, stage);
            is_optimal = stationary && now->worst <= stage.feasibility;
            if (is_optimal) break;
            const double required = set.penalty_factor * largest_pull();
            penalty = larger(required, required + set.penalty_kept * (penalty - required));
            if (!(squared > 0) || !(required <= set.largest_multiplier * slack_penalty)) break;
            const double first = smaller(1.0, longest_step / larger(program.metric(direction), 1e-300));
            const Line line = search_line(slope, first, penalty);
            slow_steps = line.used > set.slow_evaluations ? slow_steps + 1 : 0;
            if (!line.accepted || slow_steps == set.slow_steps) {
                if (was_reset) break;
                copy(hessian, initial, size * size);
                was_reset = true, slow_steps = 0;
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
        if (!(largest_equality(*now) > set.polished)) return;
        if (!is_optimal) program.differentiate(*now);
        const double *rows = now->differentiated ? now->row : trial->row;
        double gram[MOST * MOST];
        for (Index a = 0; a < e; ++a)
            for (Index b = 0; b < e; ++b) gram[a * e + b] = dot(rows + a * size, rows + b * size, size);
        for (Index used = 0; used < set.polishing_steps && largest_equality(*now) > set.polished; ++used) {
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

    // Minimises the squared violations from `now`, with steps damped in the metric and in x itself; what is left. It is
    // stuck where a step that is hardly damped is to gain next to nothing.
    double reduce_violations() {
        program.metric_matrix(metric);
        for (Index k = 0; k < size; ++k) metric[k * size + k] += 1;
        double damping = rules.initial_damping, squared = squares(*now);
        Progress progress;
        is_stuck = false;
        for (Index iteration = 0; iteration < rules.iterations; ++iteration) {
            const bool stalled = progress.stalls(squared, rules.stall_iterations, rules.stalled);
            if (squared < rules.feasible * rules.feasible || stalled || is_exhausted()) break;
            if (!program.is_known(*now)) break;
            if (damping > rules.largest_damping) break;
            program.differentiate(*now);
            program.differentiate_rows(*now, rules.reach);
            while (damping <= rules.largest_damping) {
                find_damped_step(damping);
                const bool is_gain_due = squared > rules.far && damping <= rules.initial_damping;
                if (is_gain_due && squares_left > (1 - rules.least_gain) * squared) return is_stuck = true, squared;
                for (Index k = 0; k < size; ++k) trial->x[k] = now->x[k] + direction[k];
                program.evaluate(*trial);
                if (program.watches && reach(1)) continue;
                if (squares(*trial) < squared) {
                    swap();
                    squared = squares(*now);
                    damping = larger(damping / 5, rules.smallest_damping);
                    break;
                }
                damping *= 4;
            }
        }
        return squared;
    }

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
    const Settings &set;
    const Exchange &rules;
    const Attempt &attempt;
    Index size;
    DualMethod qp;
    double slack_penalty = 1, violation_left = 0, squares_left = 0;
    double equality_pulls[MOST] = {}, step_equality_pulls[MOST] = {};
    bool elastic = false, is_tried = false;  // the latter: whether the trial is where the whole step leads
    double *initial, *matrix, *metric, *direction, *change, *gradient, *product, *right, *normal;
    // Of the differentiated rows: their values, those after a step, and how they change.
    double *squares_of_rows, *gathered, *linear, *slope;
    // Multipliers of the Lagrangian, of entries of the values, and those of the step's quadratic program.
    Index pull_count = 0, step_count = 0, *pulled, *pulling, *taken;
    double *pulls, *step_pulls, *pull_of;

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
        return {size, program.equalities, near(), rules.qp_changes, rules.qp_tolerance, by, gradient, equality,
                now->row, gathered, now->slopes, 0, nullptr, nullptr};
    }

    // Operations of the dual method: its factors, and what each change of the active rows takes.
    void count_solving() {
        const double factors = static_cast<double>(size) * size * size;
        program.work += rules.solving * (factors + static_cast<double>(qp.changes) * size * (near() + 3 * size));
    }

    void find_step() {
        program.differentiate_rows(*now, rules.looked_ahead);
        gather(*now);
        violation_left = 0;
        elastic = !qp.solve(quadratic(hessian, now->gradient, now->equality)) || qp.held < program.equalities;
        count_solving();
        if (elastic) return find_elastic_step();
        copy(direction, qp.x, size);
        for (Index e = 0; e < qp.held; ++e) step_equality_pulls[e] = -qp.pulls[e];
        step_count = qp.count - qp.held;
        for (Index k = 0; k < step_count; ++k) {
            pulling[k] = entry(qp.active[k + qp.held]);
            step_pulls[k] = qp.pulls[k + qp.held];
        }
    }

    // With a slack in every row and a quadratic penalty on them. Without the slacks it is the least of a convex function,
    // quadratic piece by piece: by Newton's method on the rows that are violated, each step as far as it falls.
    void find_elastic_step() {
        const double penalty = slack_penalty;
        program.differentiate_rows(*now, rules.reach);
        gather(*now);
        double left[MOST];
        copy(left, now->equality, MOST);
        zero(direction, size);
        copy(linear, gathered, near());
        for (Index iteration = 0; iteration < rules.elastic_iterations; ++iteration) {
            copy(matrix, hessian, size * size);
            for (Index k = 0; k < size; ++k) {
                right[k] = -dot(hessian + k * size, direction, size, now->gradient[k]);
                matrix[k * size + k] += rules.regularisation * penalty;
            }
            copy(product, right, size);
            for (Index e = 0; e < program.equalities; ++e) add_normal(row_of(e), penalty, left[e]);
            add_violated(penalty);
            program.work += rules.solving * (size * size * size / 3 + near() * size);
            copy(change, right, size);
            if (!eliminate(matrix, change, size)) break;
            follow(change, slope);
            const double length = find_lowest(penalty, left);
            bool same = length == 1;
            for (Index e = 0; e < near(); ++e) {
                const double value = linear[e] + length * slope[e];
                same &= (value < 0) == (linear[e] < 0);
                linear[e] = value;
            }
            add(length, change, size, direction);
            for (Index e = 0; e < program.equalities; ++e)
                left[e] = now->equality[e] + dot(row_of(e), direction, size);
            if (same || !(length > 0)) break;
        }
        violation_left = 0;
        for (Index e = 0; e < program.equalities; ++e) {
            step_equality_pulls[e] = penalty * left[e];
            violation_left += std::fabs(left[e]);
        }
        step_count = 0;
        for (Index e = 0; e < near(); ++e) {
            if (!(linear[e] < 0)) continue;
            violation_left -= linear[e];
            pulling[step_count] = entry(e);
            step_pulls[step_count++] = -penalty * linear[e];
        }
    }

    // Normal equations of the rows that are violated after a step, of several at once.
    void add_violated(double weight) {
        zero(squares_of_rows, size * (size + 3) / 2 * LANES);
        for (Index e = 0; e < near(); e += LANES) {
            const Bits violated = load(linear + e) < all(0);
            if (!any(violated)) continue;
            program.work += rules.solving * LANES * size * size / 2;
            const double *slopes = now->slopes + e / 8 * size * 8 + e % 8;
            const Vector value = select(violated, load(linear + e), all(0));
            Vector *sum = (Vector *)squares_of_rows;
            for (Index a = 0; a < size; ++a) {
                const Vector own = select(violated, load(slopes + 8 * a), all(0));
                for (Index b = 0; b <= a; ++b, ++sum) *sum = multiply_add(own, load(slopes + 8 * b), *sum);
                *sum = multiply_add(own, value, *sum), ++sum;
            }
        }
        const Vector *found = (const Vector *)squares_of_rows;
        for (Index a = 0; a < size; ++a) {
            for (Index b = 0; b <= a; ++b, ++found) {
                const double part = weight * sum(*found);
                matrix[a * size + b] += part;
                if (b < a) matrix[b * size + a] += part;
            }
            right[a] -= weight * sum(*found++);
        }
    }

    // How far along `change` the elastic program falls, nearly: 1 where that is so, else between two lengths where its
    // slope has other signs, by secants (Illinois). Without slacks its slope is -product now.
    double find_lowest(double penalty, const double *left) {
        double bend = 0, begin = 0;
        for (Index e = 0; e < program.equalities; ++e) {
            const double along = dot(row_of(e), change, size);
            bend += penalty * along * along;
            begin += penalty * along * left[e];
        }
        for (Index k = 0; k < size; ++k) bend += change[k] * dot(hessian + k * size, change, size);
        begin -= dot(product, change, size);
        auto slope_at = [&](double length) {
            Vector rows = all(0);
            for (Index e = 0; e < near(); e += LANES) {
                const Vector by = load(slope + e), value = load(linear + e) + all(length) * by;
                rows += select(value < all(0), value * by, all(0));
            }
            return begin + length * bend + penalty * sum(rows);
        };
        const double enough = 0.1 * std::fabs(slope_at(0));
        double low = 0, high = 1, below = slope_at(0), above = slope_at(1), length = 1, there = above;
        for (Index steps = 0; steps < 40 && std::fabs(there) > enough; ++steps) {
            if (there < 0 && length == high) {  // farther
                low = high, below = there, high = length = 2 * high;
                there = above = slope_at(high);
                continue;
            }
            length = low - below * (high - low) / (above - below);
            there = slope_at(length);
            if (there < 0) low = length, below = there, above /= 2;
            else high = length, above = there, below /= 2;
        }
        return std::isfinite(length) ? length : 0;
    }

    const double *normal_of(Index e) const {
        const double *slopes = now->slopes + e / 8 * size * 8 + e % 8;
        for (Index k = 0; k < size; ++k) normal[k] = slopes[8 * k];
        return normal;
    }

    void add_normal(const double *row, double weight, double value) {
        for (Index k = 0; k < size; ++k) add(weight * row[k], row, size, matrix + k * size);
        add(-weight * value, row, size, right);
    }

    // Least squares of the linearised violations and the damping. Rows that hold now and would be violated by the step
    // join those that are violated now, of which alone the squares left are: with others there are more.
    void find_damped_step(double damping) {
        zero(direction, size);
        for (Index k = 0; k < size * size; ++k) matrix[k] = damping * metric[k];
        zero(right, size);
        for (Index e = 0; e < program.equalities; ++e) add_normal(row_of(e), 1, now->equality[e]);
        gather(*now);
        for (Index e = 0; e < near(); ++e) taken[e] = 0;
        squares_left = 0;
        bool moved = false;
        for (Index pass = 0; pass < rules.passes; ++pass) {
            bool more = false;
            follow(direction, slope);
            Vector squares = all(0);
            for (Index first = 0; first < near(); first += LANES) {
                const Vector here = load(gathered + first), after = here + load(slope + first);
                if (!any(after < all(0))) continue;
                squares += select((here < all(0)) & (after < all(0)), after * after, all(0));
                for (Index e = first; e < first + LANES; ++e) {
                    if (taken[e] || !(gathered[e] + slope[e] < 0)) continue;
                    taken[e] = more = true;
                    add_normal(normal_of(e), 1, gathered[e]);
                }
            }
            if (pass == 1) {
                for (Index e = 0; e < program.equalities; ++e) {
                    const double missed = now->equality[e] + dot(row_of(e), direction, size);
                    squares_left += missed * missed;
                }
                squares_left += sum(squares);
            }
            if (moved && !more) return;
            copy(direction, right, size);
            if (!cholesky(matrix, size, initial)) return zero(direction, size);
            solve_cholesky(initial, size, direction);
            moved = true;
        }
    }

    double largest_pull() const {
        double most = 0;
        for (Index e = 0; e < program.equalities; ++e) most = larger(most, std::fabs(step_equality_pulls[e]));
        for (Index k = 0; k < step_count; ++k) most = larger(most, step_pulls[k]);
        return most;
    }

    bool is_stationary(double slope, const Stage &stage) const {
        double predicted = 0;
        for (Index e = 0; e < program.equalities; ++e) predicted += step_equality_pulls[e] * now->equality[e];
        predicted -= slope;
        for (Index k = 0; k < step_count; ++k) predicted -= step_pulls[k] * now->values[pulling[k]];
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
            return trial->objective + penalty * trial->violation - merit <= set.armijo * line.length * slope + rounding;
        };
        while (line.length > set.shortest_step * first) {
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
            line.length *= smaller(set.shortening[1], larger(set.shortening[0], lowest));
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
                           !any(load(trial->values + e) < all(rules.value_kept) * load(now->values + e));
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

    // Multipliers go towards those of the step; rows pulled at by either are kept.
    void follow_pulls(double length) {
        for (Index e = 0; e < program.equalities; ++e)
            equality_pulls[e] += length * (step_equality_pulls[e] - equality_pulls[e]);
        Index kept = 0;
        for (Index k = 0; k < pull_count; ++k) pull_of[pulled[k]] = 0;
        for (Index k = 0; k < step_count; ++k) pull_of[pulling[k]] = step_pulls[k];
        for (Index k = 0; k < pull_count; ++k) {
            const Index entry = pulled[k];
            const double pull = pulls[k] + length * (pull_of[entry] - pulls[k]);
            pull_of[entry] = -1;  // done
            if (pull != 0) pulled[kept] = entry, pulls[kept++] = pull;
        }
        for (Index k = 0; k < step_count; ++k)
            if (pull_of[pulling[k]] != -1 && step_pulls[k] != 0)
                pulled[kept] = pulling[k], pulls[kept++] = length * step_pulls[k];
        pull_count = kept;
    }

    // Damped BFGS, Nocedal and Wright (6.19), (18.14), (18.15), along the step that was accepted.
    void update_hessian(double length) {
        const At &before = *trial;
        follow_pulls(length);
        program.differentiate(*now);
        for (Index k = 0; k < size; ++k) {
            change[k] = now->x[k] - before.x[k];
            gradient[k] = now->gradient[k] - before.gradient[k];
            for (Index e = 0; e < program.equalities; ++e)
                gradient[k] += equality_pulls[e] * (now->row[e * size + k] - before.row[e * size + k]);
        }
        for (Index k = 0; k < pull_count; ++k) {
            program.add_slopes(*now, pulled[k], -pulls[k], gradient);
            program.add_slopes(*trial, pulled[k], pulls[k], gradient);
        }
        multiply_vector(hessian, size, size, change, product);
        const double approximated = dot(change, product, size);
        double measured = dot(change, gradient, size);
        if (approximated < 1e-20) return;
        if (measured < set.damping * approximated) {
            const double damping = (1 - set.damping) * approximated / (approximated - measured);
            for (Index k = 0; k < size; ++k) gradient[k] = damping * gradient[k] + (1 - damping) * product[k];
            measured = dot(change, gradient, size);
        }
        if (!(dot(gradient, gradient, size) < set.largest_curvature * slack_penalty * measured))
            return copy(hessian, initial, size * size);
        for (Index k = 0; k < size; ++k) {
            add(gradient[k] / measured, gradient, size, hessian + k * size);
            add(-product[k] / approximated, product, size, hessian + k * size);
        }
    }
};
