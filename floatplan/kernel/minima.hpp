// Local minima of rows of constraints over the whole flight: from a look at a grid of instants, and those that may be low
// narrowed down, several at once, each to a value of its own row at an instant of its own.

static inline void put(double *to, double value) { *to = value; }
static inline void put(double *to, Vector value) { store(to, value); }

// Sums of Chebyshev polynomials at s in [0, 1], one or those of the instants that are computed at once: series (terms,
// count), one sum every `stride` numbers.
template <typename Number>
static inline void chebyshev_sums(const double *series, Index terms, Index count, Number s, Index stride,
                                  double *sums) {
    const Number x = 4.0 * s - 2.0;
    for (Index i = 0; i < count; ++i) {
        Number next{}, after{};
        for (Index k = terms - 1; k > 0; --k) {
            const Number now = series[k * count + i] + x * next - after;
            after = next;
            next = now;
        }
        put(sums + i * stride, series[i] + 0.5 * x * next - after);
    }
}

// Rows of a flight in the plane at any instants of a motion that is given as a series.
struct PlanarRowValues {
    using At = Motion;
    const Robot &robot;
    const Constraints &constraints;
    const Series *series;

    Index count() const { return constraints.rows; }

    void lay_out(Arena &arena, Motion &m, Index instants) const {
        lay_out_motion(arena, m, robot, constraints.capsules, instants);
    }

    // The motion at so many instants s (8 ..), as far as the rows need it.
    void follow(const double *s, Index instants, Motion &m) const {
        const Index n = robot.joints;
        m.instants = instants;
        m.per_second = 1 / series->duration;
        for (Index k = 0; k < instants; k += LANES) {
            const Vector at = load(s + k);
            chebyshev_sums(series->p, series->terms, n, at, m.stride, m.sine + k);
            chebyshev_sums(series->p_rate, series->terms, n, at, m.stride, m.p_rate + k);
            if (constraints.needs_accelerations)
                chebyshev_sums(series->p_curvature, series->terms, n, at, m.stride, m.p_curvature + k);
            if (constraints.needs_places) chebyshev_sums(series->turned, series->turned_terms, 1, at, 1, m.attitude + k);
            store(m.time + k, at * all(series->duration));
        }
        swing_joints(robot.joints, m, series->centre, series->amplitude);
        compute_base_rate(robot, m, series->momentum);
        if (constraints.needs_moments) move_bodies(robot, m);
        if (constraints.needs_places) place(robot, constraints, m, 0, 0);
    }

    // Values of a row at the instants from one on, until another.
    void values(const Motion &m, Index row, Index from, Index to, double *value) const {
        row_values<Place>(terms_of(robot), constraints, m, row, from, to, value);
    }

    // Values (stride) of one of the rows (rows, stride), after those before it.
    void next(const Motion &m, Index row, double *values) const {
        next_values<Place>(terms_of(robot), constraints, m, row, values);
    }
};

// Brent's minimum within [low, high] (Algorithms for Minimization without Derivatives, 1973, chapter 5), from the lowest
// value known: next() says where the next value is wanted, take() takes it.
struct Narrowing {
    double low, high, x, fx, w, v, fw, fv, wanted, step, before;
    Index steps;

    void begin(double from, double to, double where, double least) {
        low = from;
        high = to;
        x = w = v = wanted = where;
        fx = fw = fv = least;
        step = before = 0;
        steps = 0;
    }

    bool next() {
        constexpr double golden = 0.3819660112501051, tolerance = 1e-7;
        const double middle = (low + high) / 2, last = before;
        if (++steps > 40 || std::fabs(x - middle) <= 2 * tolerance - (high - low) / 2) return false;
        double p = 0, q = 0;
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
            const double there = x + step;
            if (there - low < 2 * tolerance || high - there < 2 * tolerance) step = x < middle ? tolerance : -tolerance;
        } else {
            before = x < middle ? high - x : low - x;
            step = golden * before;
        }
        wanted = x + (std::fabs(step) >= tolerance ? step : step > 0 ? tolerance : -tolerance);
        return true;
    }

    void take(double value) {
        const double u = wanted;
        if (value <= fx) {
            (u < x ? high : low) = x;
            v = w;
            fv = fw;
            w = x;
            fw = fx;
            x = u;
            fx = value;
        } else {
            (u < x ? low : high) = u;
            if (value <= fw || w == x) {
                v = w;
                fv = fw;
                w = u;
                fw = value;
            } else if (value <= fv || v == x || v == w) {
                v = u;
                fv = value;
            }
        }
    }
};

template <typename Rows> struct MinimaWorkspace {
    static constexpr int together = 8, around = 16;  // minima at once; instants about each, as many on both sides
    typename Rows::At whole{}, close{};
    double *values, *grid, *between;  // (rows, stride), (stride), (stride) and 8 on both sides
    double *piece, *s, *value;        // of a closer look: instants (stride), minima (rows, stride)
    Index *row;

    void lay_out(Arena &arena, const Rows &rows, Index instants) {
        const Index stride = (instants + 7) / 8 * 8;
        rows.lay_out(arena, whole, instants);
        rows.lay_out(arena, close, together * around);
        arena.take(values, rows.count() * stride);
        arena.take(grid, stride);
        arena.take(between, stride + 16);
        arena.take(piece, stride);
        for (double **array : {&s, &value}) arena.take(*array, rows.count() * stride);
        arena.take(row, rows.count() * stride);
    }
};

// Narrows down some of the minima found, at most as many as are narrowed at once.
template <typename Rows>
static inline void narrow_minima(const Rows &rows, Minima &minima, Index first, Index count, typename Rows::At &close) {
    constexpr int around = MinimaWorkspace<Rows>::around, half = around / 2, together = MinimaWorkspace<Rows>::together;
    double s[together * around] = {}, low[together], high[together];
    auto value_at = [&](Index number, Index k) {
        double values[LANES];
        const Index from = k / LANES * LANES;
        rows.values(close, minima.row[first + number], from, from + LANES, values);
        return values[k - from];
    };
    for (Index number = 0; number < count; ++number) {
        const Index row = minima.row[first + number];
        const double middle = minima.s[first + number];
        low[number] = larger(middle - minima.span, minima.low[row]);
        high[number] = smaller(middle + minima.span, minima.high[row]);
        for (Index k = 0; k < half; ++k) {
            s[number * around + k] = low[number] + (middle - low[number]) * k / half;
            s[number * around + half + k] = high[number] - (high[number] - middle) * (half - 1 - k) / half;
        }
    }
    rows.follow(s, count * around, close);
    Narrowing narrowing[together];
    for (Index number = 0; number < count; ++number) {
        double &where = minima.s[first + number], &least = minima.value[first + number];
        const double middle = where, before = (middle - low[number]) / half, after = (high[number] - middle) / half;
        for (Index k = number * around; k < (number + 1) * around; ++k) {
            const double value = value_at(number, k);
            if (value < least) {
                least = value;
                where = s[k];
            }
        }
        const double step_down = where > middle ? after : before, step_up = where < middle ? before : after;
        narrowing[number].begin(larger(where - step_down, low[number]), smaller(where + step_up, high[number]), where,
                                least);
    }
    minima.looked += count * around;
    for (bool going = true; going;) {
        going = false;
        bool is_on[together];
        for (Index number = 0; number < count; ++number) {
            is_on[number] = narrowing[number].next();
            s[number] = narrowing[number].wanted;
            going |= is_on[number];
        }
        if (!going) break;
        rows.follow(s, count, close);
        for (Index number = 0; number < count; ++number) {
            if (!is_on[number]) continue;
            narrowing[number].take(value_at(number, number));
            ++minima.looked;
        }
    }
    for (Index number = 0; number < count; ++number) {
        minima.s[first + number] = narrowing[number].x;
        minima.value[first + number] = narrowing[number].fx;
    }
}

// Local minima, lower than near but for what a row falls between two instants of the grid, and where.
template <typename Rows>
static inline void find_minima(const Rows &of, Minima &minima, MinimaWorkspace<Rows> &room) {
    const Index rows = of.count(), count = minima.instants;
    typename Rows::At &m = room.whole;
    copy(room.grid, minima.grid, count);
    zero(room.grid + count, m.stride - count);
    of.follow(room.grid, count, m);
    for (Index row = 0; row < rows; ++row) of.next(m, row, room.values);
    const Vector none = all(0), outside = all(HUGE_VAL);
    double *own = room.between + 8;  // a row's, infinite before and after
    own[-1] = own[m.stride] = HUGE_VAL;
    for (Index row = 0; row < rows; ++row) {
        double *value = room.values + row * m.stride;
        const Vector low = all(minima.low[row]), high = all(minima.high[row]);
        for (Index k = 0; k < m.stride; k += LANES)
            store(own + k, select((load(room.grid + k) < low) | (load(room.grid + k) > high), outside, load(value + k)));
        for (Index k = count; k < m.stride; ++k) own[k] = HUGE_VAL;
        for (Index k = 0; k < m.stride; k += LANES) {
            const Vector here = load(own + k), before = load(own + k - 1), after = load(own + k + 1);
            const Vector rise = larger(select(before < outside, before - here, none),
                                       select(after < outside, after - here, none));
            const Bits is_low = (magnitude(here) < outside) & (here <= before) & (here <= after) &
                                (here - rise < all(minima.near));
            store(value + k, select(is_low, here, outside));
        }
    }
    minima.found = minima.looked = 0;
    for (Index k = 0; k < count; ++k)
        for (Index row = 0; row < rows; ++row) {
            const double here = room.values[row * m.stride + k];
            if (!(here < HUGE_VAL)) continue;
            minima.row[minima.found] = row;
            minima.s[minima.found] = minima.grid[k];
            minima.value[minima.found++] = here;
        }
    const Index together = MinimaWorkspace<Rows>::together;
    for (Index first = 0; first < minima.found; first += together) {
        const Index left = minima.found - first;
        narrow_minima(of, minima, first, left < together ? left : together, room.close);
    }
}

// A closer look, at so many instants for each of the grid: of its minima those join that are lower than `enough(row)`. The
// grid is looked at in pieces, of no more instants than it has.
template <typename Rows, typename Enough>
static inline void add_closer_minima(const Rows &rows, Minima &minima, Index closer, const Enough &enough,
                               MinimaWorkspace<Rows> &room) {
    const Index intervals = minima.instants - 1, most_found = minima.instants * rows.count();
    const Index intervals_of_piece = std::max<Index>(intervals / closer, 1), parts = std::min(closer, intervals);
    Minima piece = minima;
    piece.near = 0;
    piece.span = minima.span / parts;
    piece.grid = room.piece;
    piece.row = room.row;
    piece.s = room.s;
    piece.value = room.value;
    for (Index first = 0; first < intervals; first += intervals_of_piece) {
        const Index last = std::min(first + intervals_of_piece, intervals);
        piece.instants = 0;
        for (Index interval = first; interval < last; ++interval)
            for (Index part = 0; part < parts; ++part) {
                const double begin = minima.grid[interval], end = minima.grid[interval + 1];
                room.piece[piece.instants++] = begin + (end - begin) * part / parts;
            }
        room.piece[piece.instants++] = minima.grid[last];
        find_minima(rows, piece, room);
        for (Index k = 0; k < piece.found && minima.found < most_found; ++k) {
            if (!(piece.value[k] < enough(piece.row[k]))) continue;
            minima.row[minima.found] = piece.row[k];
            minima.s[minima.found] = piece.s[k];
            minima.value[minima.found++] = piece.value[k];
        }
    }
}

// Local minima as above; 1 without memory.
template <typename Rows> static inline Index find_minima(const Rows &rows, Minima &minima) {
    MinimaWorkspace<Rows> at;
    Workspace room;
    if (!room.make([&](Arena &arena) { at.lay_out(arena, rows, minima.instants); })) return 1;
    find_minima(rows, minima, at);
    return 0;
}
