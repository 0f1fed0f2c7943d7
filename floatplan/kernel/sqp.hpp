// The search from one start: floatplan/optimization/sqp.py without inequalities, in the stages of exchange.solve().

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

inline Solution Planner::minimise(double *x, Point &current, const Stage &stage, bool polish, double largest,
                                  double hopeless_way) {
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
        if (metric_norm * std::fabs(current.equality) > hopeless_way * std::sqrt(dot(m.row, m.row, size))) break;
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
            length *= smaller(set.shortening[1], larger(set.shortening[0], lowest));
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

inline Solution Planner::solve(double *x, double hopeless_way) {
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
        solution = minimise(x, current, now, was_last, larger(1.0, 1 / least), hopeless_way);
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
