// Local minima of rows of constraints over the whole flight.

// Sums of Chebyshev polynomials at s in [0, 1]: series (terms, count), one sum every `stride` numbers.
static inline void chebyshev_sums(const double *series, Index terms, Index count, double s,
                                  Index stride, double *sums) {
    const double x = 4 * s - 2;
    for (Index i = 0; i < count; ++i) {
        double next = 0, after = 0;
        for (Index k = terms - 1; k > 0; --k) {
            double now = series[k * count + i] + x * next - after;
            after = next;
            next = now;
        }
        sums[i * stride] = series[i] + x / 2 * next - after;
    }
}

// The motion at so many instants s, as far as the rows need it.
static inline void follow(const Robot &robot, const Constraints &constraints, const Series &series, const double *s,
                          Index instants, Motion &m) {
    const Index n = robot.joints;
    m.instants = instants;
    for (Index k = 0; k < instants; ++k) {
        chebyshev_sums(series.p, series.terms, n, s[k], m.stride, m.sine + k);
        chebyshev_sums(series.p_rate, series.terms, n, s[k], m.stride, m.p_rate + k);
        if (constraints.needs_accelerations)
            chebyshev_sums(series.p_curvature, series.terms, n, s[k], m.stride, m.p_curvature + k);
        if (constraints.needs_places) chebyshev_sums(series.turned, series.turned_terms, 1, s[k], 1, m.attitude + k);
        m.time[k] = s[k] * series.duration;
    }
    swing_joints(robot, m, series.centre, series.amplitude);
    turn(robot, m, series.momentum);
    if (constraints.needs_moments) move_bodies(robot, m);
    if (constraints.needs_places) place(robot, constraints, m, 0, 0);
}

// Brent's minimum within [low, high] (Algorithms for Minimization without Derivatives, 1973, chapter 5), from its
// lowest value known.
template <typename Value>
static inline void narrow(Value value_at, double low, double high, double &where, double &least) {
    constexpr double golden = 0.3819660112501051, tolerance = 1e-7;
    double x = where, w = x, v = x, fx = least, fw = fx, fv = fx, step = 0, before = 0;
    for (int steps = 0; steps < 40; ++steps) {
        double middle = (low + high) / 2;
        if (std::fabs(x - middle) <= 2 * tolerance - (high - low) / 2) break;
        double p = 0, q = 0, last = before;
        if (std::fabs(before) > tolerance) {
            double r = (x - w) * (fx - fv);
            q = (x - v) * (fx - fw);
            p = (x - v) * q - (x - w) * r;
            q = 2 * (q - r);
            if (q > 0) p = -p;
            q = std::fabs(q);
            before = step;
        }
        if (std::fabs(p) < std::fabs(q * last / 2) && p > q * (low - x) && p < q * (high - x)) {
            step = p / q;
            double next = x + step;
            if (next - low < 2 * tolerance || high - next < 2 * tolerance) step = x < middle ? tolerance : -tolerance;
        } else {
            before = x < middle ? high - x : low - x;
            step = golden * before;
        }
        double u = x + (std::fabs(step) >= tolerance ? step : step > 0 ? tolerance : -tolerance), fu = value_at(u);
        if (fu <= fx) {
            (u < x ? high : low) = x;
            v = w, fv = fw, w = x, fw = fx, x = u, fx = fu;
        } else {
            (u < x ? low : high) = u;
            if (fu <= fw || w == x)
                v = w, fv = fw, w = u, fw = fu;
            else if (fu <= fv || v == x || v == w)
                v = u, fv = fu;
        }
    }
    where = x;
    least = fx;
}

// Local minima, lower than near but for what a row falls between two instants of the grid, and where; 1 without memory.
static inline Index find_minima(const Robot &robot, const Constraints &constraints, const Series &series,
                                       Minima &minima) {
    constexpr int around = 17;
    const Index rows = constraints.rows, count = minima.instants;
    Motion m{}, close{};
    double *values;  // (rows, stride)
    Room room;
    if (!room.make([&](Arena &arena) {
            lay_out_motion(arena, m, robot, constraints.capsules, count);
            lay_out_motion(arena, close, robot, constraints.capsules, around);
            arena.take(values, rows * m.stride);
        }))
        return 1;
    for (Motion *each : {&m, &close}) {
        each->per_second = 1 / series.duration;
        zero(each->p_curvature, robot.joints * each->stride);
    }
    auto everywhere = [](Index) { return true; };
    follow(robot, constraints, series, minima.grid, count, m);
    for (Index row = 0; row < rows; ++row) {
        double *value = values + row * m.stride;
        row_values(robot, constraints, m, row, everywhere, value);
        for (Index k = 0; k < count; ++k)
            if (minima.grid[k] < minima.low[row] || minima.grid[k] > minima.high[row]) value[k] = HUGE_VAL;
    }
    minima.found = minima.looked = 0;
    for (Index k = 0; k < count; ++k)
        for (Index row = 0; row < rows; ++row) {
            const double *value = values + row * m.stride + k;
            double here = value[0], before = k > 0 ? value[-1] : HUGE_VAL, after = k + 1 < count ? value[1] : HUGE_VAL;
            if (!(std::isfinite(here) && here <= before && here <= after)) continue;
            double rise = larger(std::isfinite(before) ? before - here : 0, std::isfinite(after) ? after - here : 0);
            if (!(here - rise < minima.near)) continue;
            minima.row[minima.found] = row;
            minima.s[minima.found] = minima.grid[k];
            minima.least[minima.found++] = here;
        }
    for (Index found = 0; found < minima.found; ++found) {
        const Index row = minima.row[found];
        double &where = minima.s[found], &least = minima.least[found], s[around];
        const double low = larger(where - minima.span, minima.low[row]);
        const double high = smaller(where + minima.span, minima.high[row]);
        const double step = (high - low) / (around - 1), center = where;
        auto look = [&](const double *s, Index instants) {
            follow(robot, constraints, series, s, instants, close);
            row_values(robot, constraints, close, row, everywhere, close.value);
        };
        for (int index = 0; index < around; ++index) s[index] = index == around - 1 ? high : low + index * step;
        look(s, around);
        for (int index = 0; index < around; ++index) {
            if (s[index] == center) continue;
            ++minima.looked;
            if (close.value[index] < least) least = close.value[index], where = s[index];
        }
        auto value_at = [&](double s) {
            ++minima.looked;
            look(&s, 1);
            return close.value[0];
        };
        narrow(value_at, larger(where - step, low), smaller(where + step, high), where, least);
    }
    return 0;
}
