// Local minima of the rows of watch.hpp over the whole flight.

// Sums of Chebyshev polynomials at s in [0, 1]: series (terms, count).
static inline void chebyshev_sums(const double *series, std::int64_t terms, std::int64_t count, double s, double *sums) {
    const double x = 4 * s - 2;
    for (std::int64_t i = 0; i < count; ++i) {
        double next = 0, after = 0;
        for (std::int64_t k = terms - 1; k > 0; --k) {
            double now = series[k * count + i] + x * next - after;
            after = next;
            next = now;
        }
        sums[i] = series[i] + x / 2 * next - after;
    }
}

// A motion on its course, where it is looked at.
struct Look {
    Watched at;
    double *positions, *velocities, *accelerations, *cosines;  // (instants, joints)
    double *times, *attitude;                                  // (instants)
    double *values;                                            // (instants, rows)
    std::int64_t *wanted, *single;                             // (instants, rows), (rows)

    Look(const Course &course, std::int64_t instants) : at{} {
        at.instants = instants;
        at.momentum = course.momentum;
        at.per_second = 1 / course.duration;
    }

    void lay_out(Arena &arena, const Watch &watch) {
        watch_room(arena, watch, at, at.instants * watch.rows);
        for (double **each : {&positions, &velocities, &accelerations, &cosines}) arena.take(*each, at.instants * watch.joints);
        for (double **each : {&times, &attitude}) arena.take(*each, at.instants);
        arena.take(values, at.instants * watch.rows);
        arena.take(wanted, at.instants * watch.rows);
        arena.take(single, watch.rows);
        at.positions = positions, at.velocities = velocities, at.accelerations = accelerations;
        at.times = times, at.attitude = attitude, at.wanted = wanted;
    }

    // The motion at instants s (instants), as far as the rows need it.
    void follow(const Watch &watch, const Course &course, const double *s) {
        const std::int64_t n = watch.joints;
        for (std::int64_t k = 0; k < at.instants; ++k) {
            double *p = positions + k * n, *rate = velocities + k * n, *curvature = accelerations + k * n;
            chebyshev_sums(course.p, course.terms, n, s[k], p);
            chebyshev_sums(course.p_rate, course.terms, n, s[k], rate);
            if (watch.needs_accelerations) chebyshev_sums(course.p_curvature, course.terms, n, s[k], curvature);
            if (watch.needs_places) chebyshev_sums(course.turned, course.turned_terms, 1, s[k], attitude + k);
            times[k] = s[k] * course.duration;
        }
        sines_cosines(at.instants * n, positions, positions, cosines);
        for (std::int64_t k = 0; k < at.instants; ++k)
            for (std::int64_t i = 0; i < n; ++i) {
                const std::int64_t entry = k * n + i;
                double sine = course.amplitude[i] * positions[entry], cosine = course.amplitude[i] * cosines[entry];
                double rate = velocities[entry];
                positions[entry] = course.centre[i] + sine;
                velocities[entry] = at.per_second * cosine * rate;
                if (watch.needs_accelerations)
                    accelerations[entry] =
                        at.per_second * at.per_second * (cosine * accelerations[entry] - sine * rate * rate);
            }
        watch_rates(watch, at);
    }
};

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
static inline std::int64_t watch_minima(const Watch &watch, const Course &course, Minima &minima) {
    constexpr int around = 17;
    const std::int64_t rows = watch.rows, count = minima.instants;
    Look look(course, count);
    Room room;
    if (!room.make([&](Arena &arena) { look.lay_out(arena, watch); })) return 1;
    Watched &at = look.at;
    double *values = look.values;
    for (std::int64_t entry = 0; entry < count * rows; ++entry) look.wanted[entry] = entry;
    look.follow(watch, course, minima.grid);
    watch_values(watch, at, values);
    for (std::int64_t k = 0; k < count; ++k)
        for (std::int64_t row = 0; row < rows; ++row)
            if (minima.grid[k] < minima.low[row] || minima.grid[k] > minima.high[row]) values[k * rows + row] = HUGE_VAL;
    minima.found = minima.looked = 0;
    for (std::int64_t k = 0; k < count; ++k)
        for (std::int64_t row = 0; row < rows; ++row) {
            double here = values[k * rows + row];
            double before = k > 0 ? values[(k - 1) * rows + row] : HUGE_VAL;
            double after = k + 1 < count ? values[(k + 1) * rows + row] : HUGE_VAL;
            if (!(std::isfinite(here) && here <= before && here <= after)) continue;
            double rise = larger(std::isfinite(before) ? before - here : 0, std::isfinite(after) ? after - here : 0);
            if (!(here - rise < minima.near)) continue;
            minima.row[minima.found] = row;
            minima.s[minima.found] = minima.grid[k];
            minima.least[minima.found++] = here;
        }
    at.wanted = look.single;
    for (std::int64_t row = 0; row < rows; ++row) look.single[row] = -1;
    for (std::int64_t found = 0; found < minima.found; ++found) {
        const std::int64_t row = minima.row[found];
        double &where = minima.s[found], &least = minima.least[found], value;
        double low = larger(where - minima.span, minima.low[row]), high = smaller(where + minima.span, minima.high[row]);
        at.instants = 1;
        look.single[row] = 0;
        auto value_at = [&](double s) {
            ++minima.looked;
            look.follow(watch, course, &s);
            watch_values(watch, at, &value);
            return value;
        };
        double step = (high - low) / (around - 1), center = where;
        for (int index = 0; index < around; ++index) {
            double s = index == around - 1 ? high : low + index * step;
            if (s == center) continue;
            double now = value_at(s);
            if (now < least) {
                least = now;
                where = s;
            }
        }
        narrow(value_at, larger(where - step, low), smaller(where + step, high), where, least);
        look.single[row] = -1;
    }
    return 0;
}
