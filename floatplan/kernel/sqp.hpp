// The search from one start of a plain problem: as constrained.hpp, without rows, in the stages of exchange.hpp. The
// inverse of the Hessian is kept: a step then needs products only (Nocedal and Wright, section 16.2, range-space method).

inline Solution Planner::minimise(double *x, Point &current, const Stage &stage, bool polish, double largest,
                                  double hopeless_way) {
    const Settings &set = settings;
    double penalty = 0, multiplier = 0, slack_penalty = set.slack_penalty * largest;
    bool was_reset = true, is_optimal = false, h_is_initial = true;
    Index slow_steps = 0, iteration = 0;
    const double *polishing_row = m.row;
    copy(m.h_initial, m.h, size * size);
    while (size && iteration < stage.iterations) {
        ++iteration;
        if (!current.differentiated) differentiate(current, m.row);
        polishing_row = m.row;
        // The step d = -H^-1 (g + A^T y), with the y for which it meets the linearised equality; g = x.
        multiply(x, 1, size, m.h, size, m.direction);
        multiply(m.row, 1, size, m.h, size, m.mapped);
        double curvature = dot(m.row, m.mapped, size);
        if (metric_norm * std::fabs(current.equality) > hopeless_way * std::sqrt(dot(m.row, m.row, size))) break;
        if (!(curvature > 0)) break;  // nothing turns the base
        double y = (current.equality - dot(m.row, m.direction, size)) / curvature;
        for (Index k = 0; k < size; ++k) {
            m.direction[k] = -(m.direction[k] + y * m.mapped[k]);
            m.lagrangian[k] = x[k] + y * m.row[k];
        }
        double slope = dot(x, m.direction, size), squared = dot(m.direction, m.direction, size);
        double predicted = y * current.equality - slope;
        bool stationary = std::fabs(predicted) <= stage.optimality * (1 + std::fabs(current.objective));
        if (stationary && std::fabs(current.equality) <= stage.feasibility) {
            is_optimal = true;
            break;
        }
        double required = set.penalty_factor * std::fabs(y);
        penalty = larger(required, required + set.penalty_kept * (penalty - required));
        if (!(squared > 0) || !(required <= set.largest_multiplier * slack_penalty)) break;
        bool is_long = metric_norm * std::sqrt(squared) > set.longest_step;
        double first = is_long ? smaller(1.0, set.longest_step / metric(m.direction)) : 1;

        // Line search for the l1 merit function.
        double violation = std::fabs(current.equality), merit = current.objective + penalty * violation;
        double descent = smaller(slope - penalty * violation, 0.0), rounding = 1e-13 * (1 + std::fabs(merit));
        double length = first;
        Index used = 0;
        bool accepted = false;
        Point trial;
        while (length > set.shortest_step * first) {
            for (Index k = 0; k < size; ++k) m.trial[k] = x[k] + length * m.direction[k];
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
            copy(m.h, m.h_initial, size * size);
            h_is_initial = was_reset = true;
            slow_steps = 0;
            continue;
        }
        copy(x, m.trial, size);
        std::swap(m.row, m.previous_row);
        polishing_row = m.previous_row;
        current = trial;
        if (stationary && length == 1 && std::fabs(current.equality) <= stage.feasibility) {
            is_optimal = true;
            break;
        }
        // Damped BFGS of the inverse, Nocedal and Wright (6.17), (18.14), (18.15).
        multiplier += length * (y - multiplier);
        differentiate(current, m.row);
        double *step = m.trial;
        for (Index k = 0; k < size; ++k) {
            step[k] = length * m.direction[k];
            m.product[k] = -length * m.lagrangian[k];
            m.change[k] = multiplier * (m.row[k] - m.previous_row[k]) + step[k];
        }
        double approximated = dot(step, m.product, size), measured = dot(step, m.change, size);
        if (!(approximated < 1e-20)) {
            if (measured < set.damping * approximated) {
                double damping = (1 - set.damping) * approximated / (approximated - measured);
                for (Index k = 0; k < size; ++k)
                    m.change[k] = damping * m.change[k] + (1 - damping) * m.product[k];
                measured = dot(step, m.change, size);
            }
            if (dot(m.change, m.change, size) < set.largest_curvature * slack_penalty * measured) {
                multiply(m.change, 1, size, m.h, size, m.mapped);
                double scale = 0.5 + 0.5 * dot(m.change, m.mapped, size) / measured;
                for (Index k = 0; k < size; ++k) m.half[k] = (scale * length * m.direction[k] - m.mapped[k]) / measured;
                for (Index r = 0; r < size; ++r)
                    for (Index k = 0; k < size; ++k)
                        m.h[r * size + k] += step[r] * m.half[k] + m.half[r] * length * m.direction[k];
                h_is_initial = false;
            } else if (!h_is_initial) {
                copy(m.h, m.h_initial, size * size);
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
        for (Index used = 0; used < set.polishing_steps; ++used) {
            if (!(std::fabs(current.equality) > set.polished) || !(square > 0)) break;
            double y = current.equality / square;
            for (Index k = 0; k < size; ++k) m.trial[k] = x[k] - y * polishing_row[k];
            Point trial = evaluate(m.trial);
            if (!(std::fabs(trial.equality) < std::fabs(current.equality))) break;
            copy(x, m.trial, size);
            current = trial;
        }
    }
    bool holds = std::fabs(current.equality) <= stage.feasibility;
    return {holds ? (is_optimal ? optimal : feasible) : infeasible, iteration};
}

inline Solution Planner::solve(double *x, double hopeless_way) {
    Point current;
    Index at = settings.first_level;
    for (;; ++at) {
        if (!at_level(at)) return {needs_grid, 0};
        current = evaluate(x);
        if (unresolved() < settings.coarsely_resolved || at + 1 == settings.levels) break;
    }
    Index order[3], stages = 0, stage = 0, iterations = 0;
    if (level_needed(settings.stages[0].quadrature_error) > at) order[stages++] = 0;
    if (level_needed(settings.stages[2].quadrature_error) > at) order[stages++] = 1;
    order[stages++] = 2;
    zero(m.h, size * size);
    for (Index k = 0; k < size; ++k) m.h[k * size + k] = 1;
    Solution solution{infeasible, 0};
    for (Index round = 0; round < settings.most_rounds; ++round) {
        const Stage &now = settings.stages[order[stage]];
        double least = 1;
        for (Index k = 0; k < size; ++k) least = smaller(least, m.h[k * size + k]);
        bool was_last = stage + 1 == stages;
        solution = minimise(x, current, now, was_last, larger(1.0, 1 / least), hopeless_way);
        iterations += solution.iterations;
        if (!was_last) ++stage;
        if (size && iterations > settings.most_iterations) break;
        if (solution.status == infeasible && (was_last || !(std::fabs(current.equality) <= settings.hopeless))) break;
        if (current.number != evaluations) current = evaluate(x);  // the last one was a trial that was rejected
        Index needed = level_needed(settings.stages[order[stage]].quadrature_error);
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
