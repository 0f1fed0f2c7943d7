// Restoration: from a motion to one that violates next to nothing, whatever it costs, by the method of Levenberg and
// Marquardt (Nocedal and Wright, section 10.3) for
//
//     minimise  sum_e c_e(x)^2 + sum_i min(0, v_i(x))^2.
//
// A step minimises that of the linearised constraints and mu d (M + 1) d, M being the metric in which steps are measured; the
// damping mu falls where a step gains and rises where it does not.

// From `now`; the squares that are left. It is stuck where a step that is hardly damped is to gain next to nothing.
template <typename Flight> double Sqp<Flight>::reduce_violations() {
    constexpr double less_damping = 5, more_damping = 4;  // [-] factors after a step that gains, and after one that does not
    program.metric_matrix(metric);
    for (Index k = 0; k < size; ++k) metric[k * size + k] += 1;
    double damping = exchange.initial_damping, squared = squares(*now);
    Progress progress;
    is_stuck = false;
    for (Index iteration = 0; iteration < exchange.iterations; ++iteration) {
        const bool stalled = progress.stalls(squared, exchange.stall_iterations, exchange.stalled);
        if (squared < exchange.feasible * exchange.feasible || stalled || is_exhausted()) break;
        if (!program.is_known(*now) || damping > exchange.largest_damping) break;
        program.differentiate(*now);
        program.differentiate_rows(*now, exchange.reach);
        while (damping <= exchange.largest_damping) {
            find_damped_step(damping);
            const bool is_gain_due = squared > exchange.far && damping <= exchange.initial_damping;
            if (is_gain_due && squares_left > (1 - exchange.least_gain) * squared) {
                is_stuck = true;
                return squared;
            }
            for (Index k = 0; k < size; ++k) trial->x[k] = now->x[k] + direction[k];
            program.evaluate(*trial);
            if (program.watches && reach(1)) continue;  // with the rows that it has reached, once more
            if (squares(*trial) < squared) {
                swap();
                squared = squares(*now);
                damping = larger(damping / less_damping, exchange.smallest_damping);
                break;
            }
            damping *= more_damping;
        }
    }
    return squared;
}

// Least squares of the linearised violations and the damping. Rows that hold now and would be violated by the step join
// those that are violated now, of which alone the squares left are: with others there are more.
template <typename Flight> void Sqp<Flight>::find_damped_step(double damping) {
    zero(direction, size);
    for (Index k = 0; k < size * size; ++k) matrix[k] = damping * metric[k];
    zero(right, size);
    for (Index e = 0; e < program.equalities; ++e) add_normal(row_of(e), 1, now->equality[e]);
    gather(*now);
    for (Index e = 0; e < near(); ++e) taken[e] = 0;
    squares_left = 0;
    bool moved = false;
    for (Index pass = 0; pass < exchange.passes; ++pass) {
        bool more = false;
        follow(direction, slope);
        Vector squares = all(0);
        for (Index first = 0; first < near(); first += LANES) {
            const Vector here = load(gathered + first);
            const Vector after = here + load(slope + first);
            if (!any(after < all(0))) continue;
            squares += select((here < all(0)) & (after < all(0)), after * after, all(0));
            for (Index e = first; e < first + LANES; ++e) {
                if (taken[e] || !(gathered[e] + slope[e] < 0)) continue;
                taken[e] = true;
                more = true;
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
