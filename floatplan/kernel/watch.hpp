// Rows that are watched during a flight, and their derivatives: distances, and sums of the moments and rates.
//
// The same as floatplan/motion/planar/closed_form.py and clearance.py, instant by instant.

struct Place {
    double x, y;
};

static inline Place operator+(Place a, Place b) { return {a.x + b.x, a.y + b.y}; }
static inline Place operator-(Place a, Place b) { return {a.x - b.x, a.y - b.y}; }
static inline Place operator*(double s, Place a) { return {s * a.x, s * a.y}; }
static inline double inner(Place a, Place b) { return a.x * b.x + a.y * b.y; }
static inline double outer(Place a, Place b) { return a.x * b.y - a.y * b.x; }

// A distance, the unit vector out of the other thing, and how far along each of the two the nearest points are.
struct Nearest {
    double distance;
    Place direction;
    double own, other;
};

static inline void sines_cosines(std::int64_t count, const double *angle, double *sine, double *cosine) {
    Vector s, c;
    std::int64_t i = 0;
    for (; i + LANES <= count; i += LANES) {
        sine_cosine(load(angle + i), s, c);
        store(sine + i, s);
        store(cosine + i, c);
    }
    double rest[LANES] = {};
    for (std::int64_t j = i; j < count; ++j) rest[j - i] = angle[j];
    sine_cosine(load(rest), s, c);
    for (std::int64_t j = i; j < count; ++j) {
        sine[j] = s[j - i];
        cosine[j] = c[j - i];
    }
}

static inline Nearest point_to_segment(Place point, Place start, Place end) {
    Place along = end - start;
    double squared = larger(inner(along, along), 1e-300);
    double share = smaller(larger(inner(along, point - start) / squared, 0), 1);
    Place offset = start + share * along - point;
    double distance = std::sqrt(inner(offset, offset));
    if (distance >= 1e-12) return {distance, 1 / distance * offset, share, 0};
    double length = std::sqrt(squared);
    Place sideways{-along.y / length, along.x / length};
    return {distance, inner(sideways, sideways) > 0.25 ? sideways : Place{0, 1}, share, 0};
}

static inline bool are_crossing(Place start, Place end, Place other_start, Place other_end) {
    constexpr double in_line = 1e-12;  // m^2
    double a = outer(end - start, other_start - start), b = outer(end - start, other_end - start);
    Place along = other_end - other_start;
    double c = outer(along, start - other_start), d = outer(along, end - other_start);
    double least = smaller(smaller(std::fabs(a), std::fabs(b)), smaller(std::fabs(c), std::fabs(d)));
    return a * b < 0 && c * d < 0 && least > in_line;
}

static inline Nearest between(Place start, Place end, Place other_start, Place other_end) {
    Nearest best = point_to_segment(start, other_start, other_end);
    best = {best.distance, -1 * best.direction, 0, best.own};
    Nearest next = point_to_segment(end, other_start, other_end);
    if (next.distance < best.distance) best = {next.distance, -1 * next.direction, 1, next.own};
    next = point_to_segment(other_start, start, end);
    if (next.distance < best.distance) best = {next.distance, next.direction, next.own, 0};
    next = point_to_segment(other_end, start, end);
    if (next.distance < best.distance) best = {next.distance, next.direction, next.own, 1};
    if (are_crossing(start, end, other_start, other_end)) {
        best.distance = -best.distance;
        best.direction = -1 * best.direction;
    }
    return best;
}

// theta0' (instants), its derivatives by velocities (instants, joints) and by h (instants); rotations at orientation 0.
static inline void watch_rates(const Watch &watch, Watched &at) {
    const std::int64_t n = watch.joints, m = watch.bodies;
    for (std::int64_t k = 0; k < at.instants; ++k)
        for (std::int64_t b = 0; b < m; ++b) {
            double angle = watch.offsets[b];
            for (std::int64_t i = 0; i < n; ++i) angle += watch.turns[b * n + i] * at.positions[k * n + i];
            at.real[k * m + b] = angle;
        }
    sines_cosines(at.instants * m, at.real, at.imaginary, at.real);
    for (std::int64_t k = 0; k < at.instants; ++k) {
        double *ex = at.real + k * m, *ey = at.imaginary + k * m, *by_velocity = at.by_velocity + k * n;
        for (std::int64_t b = 0; b < m; ++b) ey[b] *= watch.turn;
        double locked = 0;
        for (std::int64_t i = 0; i < n; ++i) by_velocity[i] = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            double x = 0, y = 0;
            for (std::int64_t c = 0; c < m; ++c) {
                double re = watch.real[b * m + c], im = watch.imaginary[b * m + c];
                x += re * ex[c] - im * ey[c];
                y += re * ey[c] + im * ex[c];
            }
            double inertia = ex[b] * x + ey[b] * y + watch.inertia[b];
            locked += inertia;
            for (std::int64_t i = 0; i < n; ++i) by_velocity[i] += inertia * watch.turns[b * n + i];
        }
        double moving = at.momentum;
        for (std::int64_t i = 0; i < n; ++i) {
            moving -= by_velocity[i] * at.velocities[k * n + i];
            by_velocity[i] /= -locked;
        }
        at.rate[k] = moving / locked;
        at.by_momentum[k] = 1 / locked;
    }
}

// Derivatives of theta0' by positions (instants, joints).
static inline void watch_rate_slopes(const Watch &watch, Watched &at) {
    const std::int64_t n = watch.joints, m = watch.bodies;
    for (std::int64_t k = 0; k < at.instants; ++k) {
        const double *ex = at.real + k * m, *ey = at.imaginary + k * m;
        double *by_position = at.by_position + k * n, *rates = at.scratch;
        for (std::int64_t b = 0; b < m; ++b) {
            rates[b] = at.rate[k];
            for (std::int64_t i = 0; i < n; ++i) rates[b] += watch.turns[b * n + i] * at.velocities[k * n + i];
        }
        for (std::int64_t i = 0; i < n; ++i) by_position[i] = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            double total = 0;
            for (std::int64_t c = 0; c < m; ++c) {
                double re = watch.real[b * m + c], im = watch.imaginary[b * m + c];
                double x = re * ex[c] - im * ey[c], y = re * ey[c] + im * ex[c];
                total += (ex[b] * y - ey[b] * x) * (rates[c] + rates[b]);
            }
            total *= watch.turn;
            for (std::int64_t i = 0; i < n; ++i) by_position[i] += total * watch.turns[b * n + i];
        }
        for (std::int64_t i = 0; i < n; ++i) by_position[i] *= -at.by_momentum[k];
    }
}

// Moments (instants, bodies) that turn the bodies.
static inline void watch_moments(const Watch &watch, Watched &at) {
    const std::int64_t n = watch.joints, m = watch.bodies;
    double *relative = at.scratch, *swing = relative + m, *gathered = swing + m, *alone = gathered + m;
    for (std::int64_t k = 0; k < at.instants; ++k) {
        const double *ex = at.real + k * m, *ey = at.imaginary + k * m;
        double *moments = at.moments + k * m, push = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            double rate = at.rate[k];
            relative[b] = 0;
            for (std::int64_t i = 0; i < n; ++i) {
                rate += watch.turns[b * n + i] * at.velocities[k * n + i];
                relative[b] += watch.turns[b * n + i] * at.accelerations[k * n + i];
            }
            swing[b] = watch.turn * rate * rate;
        }
        for (std::int64_t b = 0; b < m; ++b) {
            double x = 0, y = 0, alone_x = 0, alone_y = 0;
            for (std::int64_t c = 0; c < m; ++c) {
                double re = watch.real[b * m + c], im = watch.imaginary[b * m + c];
                double real = re * ex[c] - im * ey[c], imaginary = re * ey[c] + im * ex[c];
                alone_x += real;
                alone_y += imaginary;
                x += real * relative[c] - imaginary * swing[c];
                y += imaginary * relative[c] + real * swing[c];
            }
            gathered[b] = ex[b] * x + ey[b] * y + watch.inertia[b] * relative[b];
            alone[b] = ex[b] * alone_x + ey[b] * alone_y + watch.inertia[b];
            push += gathered[b];
        }
        double base = -push * at.by_momentum[k];
        for (std::int64_t b = 0; b < m; ++b) moments[b] = gathered[b] + base * alone[b];
        at.base_acceleration[k] = base;
    }
}

// Rotations at the orientation there is, and the ends of the capsules.
static inline void watch_places(const Watch &watch, Watched &at) {
    const std::int64_t m = watch.bodies, capsules = watch.capsules;
    sines_cosines(at.instants, at.attitude, at.turned_sine, at.turned_cosine);
    for (std::int64_t k = 0; k < at.instants; ++k) {
        double c = at.turned_cosine[k], s = watch.turn * at.turned_sine[k];
        const double *ex = at.real + k * m, *ey = at.imaginary + k * m, *path = watch.path, t = at.times[k];
        const double com_x = path[0] + path[2] * t, com_y = path[1] + path[3] * t - path[4] * t * t / 2;
        double *tx = at.turned_real + k * m, *ty = at.turned_imaginary + k * m;
        for (std::int64_t b = 0; b < m; ++b) {
            tx[b] = ex[b] * c - ey[b] * s;
            ty[b] = ex[b] * s + ey[b] * c;
        }
        for (std::int64_t e = 0; e < 2 * capsules; ++e) {
            const double *wx = watch.ends_real + e * m, *wy = watch.ends_imaginary + e * m;
            double x = com_x, y = com_y;
            for (std::int64_t b = 0; b < m; ++b) {
                x += tx[b] * wx[b] - ty[b] * wy[b];
                y += tx[b] * wy[b] + ty[b] * wx[b];
            }
            at.ends[(k * 2 * capsules + e) * 2] = x;
            at.ends[(k * 2 * capsules + e) * 2 + 1] = y;
        }
    }
}

static inline Nearest nearest_of(const Watch &watch, const Watched &at, std::int64_t k, std::int64_t row) {
    auto end = [&](std::int64_t index) {
        const double *place = at.ends + (k * 2 * watch.capsules + index) * 2;
        return Place{place[0], place[1]};
    };
    const std::int64_t first = watch.first[row], second = watch.second[row];
    if (watch.kind[row] == pair_row) {
        Nearest found = between(end(2 * first), end(2 * first + 1), end(2 * second), end(2 * second + 1));
        found.distance -= watch.radius[first] + watch.radius[second];
        return found;
    }
    const double *obstacle = watch.obstacles + 7 * second, time = at.times[k];
    Place moved = time * Place{obstacle[4], obstacle[5]}, one = Place{obstacle[0], obstacle[1]} + moved;
    Place other{obstacle[2], obstacle[3]};
    Nearest found;
    if (watch.kind[row] == circle_row)
        found = point_to_segment(one, end(2 * first), end(2 * first + 1));
    else if (watch.kind[row] == bar_row)
        found = between(end(2 * first), end(2 * first + 1), one, other + moved);
    else {  // the half-plane's normal is the other place
        double share = watch.kind[row] == half_plane_end_row;
        found = {inner(other, end(2 * first + (share == 1)) - one), other, share, 0};
    }
    found.distance -= watch.radius[first] + obstacle[6];
    return found;
}

// Values of the rows where they are wanted: at.wanted (instants, rows) says where each goes, or is negative.
static inline void watch_values(const Watch &watch, Watched &at, double *values) {
    const std::int64_t n = watch.joints, m = watch.bodies, terms = 2 + m + 2 * n;
    if (watch.needs_moments) watch_moments(watch, at);
    if (watch.needs_places) watch_places(watch, at);
    for (std::int64_t k = 0; k < at.instants; ++k)
        for (std::int64_t row = 0; row < watch.rows; ++row) {
            const std::int64_t target = at.wanted[k * watch.rows + row];
            if (target < 0) continue;
            double value;
            if (watch.kind[row] == sum_row) {
                const double *sum = watch.sums + watch.first[row] * terms;
                value = sum[0] + sum[1] * at.rate[k];
                for (std::int64_t i = 0; i < n; ++i) value += sum[2 + i] * at.velocities[k * n + i];
                if (watch.needs_accelerations)
                    for (std::int64_t i = 0; i < n; ++i) value += sum[2 + n + i] * at.accelerations[k * n + i];
                if (watch.needs_moments)
                    for (std::int64_t b = 0; b < m; ++b) value += sum[2 + 2 * n + b] * at.moments[k * m + b];
            } else {
                Nearest found = nearest_of(watch, at, k, row);
                value = (found.distance - watch.least[row]) * watch.per_scale[row];
                double *kept = at.nearest + target * 4;
                kept[0] = found.direction.x;
                kept[1] = found.direction.y;
                kept[2] = found.own;
                kept[3] = found.other;
            }
            values[target] = value - at.back_off;
        }
}

// Derivatives (size) by x of what has some by position, velocity, acceleration (joints) and h, added to a row.
static inline void chain(const Watch &watch, const Watched &at, std::int64_t k, const double *by, double by_momentum,
                         bool moving, double *row) {
    const std::int64_t n = watch.joints;
    const double per_second = at.per_second, *b0 = at.basis + k * at.size, *b1 = b0 + at.instants * at.size,
                 *b2 = b1 + at.instants * at.size;
    for (std::int64_t i = 0; i < n; ++i) {
        double sine = at.sine[k * n + i], cosine = at.cosine[k * n + i], p_rate = at.p_rate[k * n + i];
        double w0 = by[i] * cosine;
        const std::int64_t from = at.columns[i], to = at.columns[i + 1];
        if (!moving) {
            for (std::int64_t c = from; c < to; ++c) row[c] += w0 * b0[c];
            continue;
        }
        double swing = per_second * sine * p_rate, w1 = by[n + i] * per_second * cosine;
        w0 -= by[n + i] * swing;
        if (!at.curvature) {
            for (std::int64_t c = from; c < to; ++c) row[c] += w0 * b0[c] + w1 * b1[c];
            continue;
        }
        double acceleration = by[2 * n + i] * per_second;
        w0 -= acceleration * per_second * (sine * at.curvature[k * n + i] + cosine * p_rate * p_rate);
        w1 -= 2 * acceleration * swing;
        double w2 = acceleration * per_second * cosine;
        for (std::int64_t c = from; c < to; ++c) row[c] += w0 * b0[c] + w1 * b1[c] + w2 * b2[c];
    }
    for (std::int64_t c = at.columns[n]; c < at.size; ++c) row[c] += by_momentum * at.axes[c - at.columns[n]];
}

// Derivatives (instants, size) of theta0' by x, at so many of the first instants.
static inline void watch_drift(const Watch &watch, Watched &at, std::int64_t instants, double *drift) {
    const std::int64_t n = watch.joints;
    watch_rate_slopes(watch, at);
    double *by = at.scratch;
    const double *curvature = at.curvature;
    at.curvature = nullptr;
    std::memset(drift, 0, instants * at.size * sizeof(double));
    for (std::int64_t k = 0; k < instants; ++k) {
        for (std::int64_t i = 0; i < n; ++i) {
            by[i] = at.by_position[k * n + i];
            by[n + i] = at.by_velocity[k * n + i];
        }
        chain(watch, at, k, by, at.by_momentum[k], true, drift + k * at.size);
    }
    at.curvature = curvature;
}

// Derivatives (bodies, 3 joints + 1) of the moments at an instant, by positions, velocities, accelerations and h.
static inline void moment_slopes(const Watch &watch, const Watched &at, std::int64_t k, double *direct, double *room) {
    const std::int64_t n = watch.joints, m = watch.bodies, columns = 3 * n + 1;
    const double *ex = at.real + k * m, *ey = at.imaginary + k * m, turn = watch.turn;
    double *rates = room, *accelerations = rates + m, *column_sums = accelerations + m, *response = column_sums + m;
    for (std::int64_t b = 0; b < m; ++b) {
        rates[b] = at.rate[k];
        accelerations[b] = at.base_acceleration[k];
        for (std::int64_t i = 0; i < n; ++i) {
            rates[b] += watch.turns[b * n + i] * at.velocities[k * n + i];
            accelerations[b] += watch.turns[b * n + i] * at.accelerations[k * n + i];
        }
    }
    for (std::int64_t c = 0; c < columns; ++c) response[c] = 0;
    for (std::int64_t b = 0; b < m; ++b) {
        double *by = direct + b * columns, by_base = 0, total = 0, whirl = 0;
        for (std::int64_t c = 0; c < columns; ++c) by[c] = 0;
        for (std::int64_t c = 0; c < m; ++c) {
            double re = watch.real[b * m + c], im = watch.imaginary[b * m + c];
            double x = re * ex[c] - im * ey[c], y = re * ey[c] + im * ex[c];
            double real = ex[b] * x + ey[b] * y, imaginary = ex[b] * y - ey[b] * x;
            whirl += imaginary * accelerations[c] + real * turn * rates[c] * rates[c];
            double by_acceleration = real + (b == c ? watch.inertia[b] : 0);
            double by_rate = -2 * turn * imaginary * rates[c];
            double by_angle = -turn * imaginary * accelerations[c] - real * rates[c] * rates[c];
            by_base += by_rate;
            total += by_acceleration;
            const double *turns = watch.turns + c * n;
            for (std::int64_t i = 0; i < n; ++i) {
                by[i] += by_angle * turns[i];
                by[n + i] += by_rate * turns[i];
                by[2 * n + i] += by_acceleration * turns[i];
            }
        }
        column_sums[b] = total;
        for (std::int64_t i = 0; i < n; ++i) {
            by[i] += turn * whirl * watch.turns[b * n + i] + by_base * at.by_position[k * n + i];
            by[n + i] += by_base * at.by_velocity[k * n + i];
        }
        by[3 * n] = by_base * at.by_momentum[k];
        for (std::int64_t c = 0; c < columns; ++c) response[c] += by[c];
    }
    for (std::int64_t c = 0; c < columns; ++c) response[c] *= at.by_momentum[k];
    for (std::int64_t b = 0; b < m; ++b)
        for (std::int64_t c = 0; c < columns; ++c) direct[b * columns + c] -= column_sums[b] * response[c];
}

// Partials (3 joints + 1) of a sum of moments, accelerations, velocities and theta0'.
static inline double sum_slopes(const Watch &watch, const Watched &at, std::int64_t k, const double *sum,
                                const double *direct, double *by) {
    const std::int64_t n = watch.joints, m = watch.bodies, columns = 3 * n + 1;
    for (std::int64_t i = 0; i < n; ++i) {
        by[i] = sum[1] * at.by_position[k * n + i];
        by[n + i] = sum[1] * at.by_velocity[k * n + i] + sum[2 + i];
        by[2 * n + i] = sum[2 + n + i];
    }
    by[3 * n] = sum[1] * at.by_momentum[k];
    if (watch.needs_moments)
        for (std::int64_t b = 0; b < m; ++b) {
            double weight = sum[2 + 2 * n + b];
            if (weight != 0)
                for (std::int64_t c = 0; c < columns; ++c) by[c] += weight * direct[b * columns + c];
        }
    return by[3 * n];
}

// Derivatives (where at.wanted says, size) of the rows by x; after watch_values and watch_drift of the same motion.
static inline void watch_jacobian(const Watch &watch, Watched &at, double *jacobian) {
    const std::int64_t n = watch.joints, m = watch.bodies, terms = 2 + m + 2 * n, columns = 3 * n + 1;
    double *direct = at.scratch, *by = direct + m * columns, *room = by + columns;
    for (std::int64_t k = 0; k < at.instants; ++k) {
        const std::int64_t *wanted = at.wanted + k * watch.rows;
        bool known = false;
        for (std::int64_t row = 0; row < watch.rows; ++row) {
            if (wanted[row] < 0) continue;
            double *target = jacobian + wanted[row] * at.size;
            if (watch.kind[row] == sum_row) {
                if (watch.opposite[row] >= 0 && wanted[watch.opposite[row]] >= 0) {  // and before this row
                    const double *other = jacobian + wanted[watch.opposite[row]] * at.size;
                    for (std::int64_t c = 0; c < at.size; ++c) target[c] = -other[c];
                    continue;
                }
                if (!known && watch.needs_moments) moment_slopes(watch, at, k, direct, room);
                known = true;
                double by_momentum = sum_slopes(watch, at, k, watch.sums + watch.first[row] * terms, direct, by);
                for (std::int64_t c = 0; c < at.size; ++c) target[c] = 0;
                chain(watch, at, k, by, by_momentum, true, target);
                continue;
            }
            const double *kept = at.nearest + wanted[row] * 4, *tx = at.turned_real + k * m,
                         *ty = at.turned_imaginary + k * m;
            double base = 0;
            for (std::int64_t i = 0; i < n; ++i) by[i] = 0;
            for (int side = 0; side < 1 + (watch.kind[row] == pair_row); ++side) {
                const std::int64_t capsule = side ? watch.second[row] : watch.first[row];
                double share = kept[2 + side], sign = side ? -watch.per_scale[row] : watch.per_scale[row];
                const double *wx = watch.ends_real + 2 * capsule * m, *wy = watch.ends_imaginary + 2 * capsule * m;
                for (std::int64_t b = 0; b < m; ++b) {
                    double x = (1 - share) * wx[b] + share * wx[m + b], y = (1 - share) * wy[b] + share * wy[m + b];
                    double px = tx[b] * x - ty[b] * y, py = tx[b] * y + ty[b] * x;
                    double part = sign * watch.turn * (kept[1] * px - kept[0] * py);
                    base += part;
                    for (std::int64_t i = 0; i < n; ++i) by[i] += part * watch.turns[b * n + i];
                }
            }
            for (std::int64_t c = 0; c < at.size; ++c) target[c] = base * at.attitude_slopes[k * at.size + c];
            chain(watch, at, k, by, 0, false, target);
        }
    }
}

// Gradient (size) by x of a weighted sum of moments, accelerations and velocities: weights (instants, terms).
static inline void watch_gradient(const Watch &watch, Watched &at, const double *weights, std::int64_t instants,
                                  double *gradient) {
    const std::int64_t n = watch.joints, m = watch.bodies, terms = 2 + m + 2 * n, columns = 3 * n + 1;
    double *direct = at.scratch, *by = direct + m * columns, *room = by + columns;
    for (std::int64_t c = 0; c < at.size; ++c) gradient[c] = 0;
    for (std::int64_t k = 0; k < instants; ++k) {
        if (watch.needs_moments) moment_slopes(watch, at, k, direct, room);
        double by_momentum = sum_slopes(watch, at, k, weights + k * terms, direct, by);
        chain(watch, at, k, by, by_momentum, true, gradient);
    }
}

// ---- local minima of rows over the whole flight

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

// The motion at instants s (instants), as far as the rows need it.
static inline void follow_course(const Watch &watch, Watched &at, const Course &course, const double *s) {
    const std::int64_t n = watch.joints;
    for (std::int64_t k = 0; k < at.instants; ++k) {
        double *p = course.positions + k * n, *rate = course.velocities + k * n, *curvature = course.accelerations + k * n;
        chebyshev_sums(course.p, course.terms, n, s[k], p);
        chebyshev_sums(course.p_rate, course.terms, n, s[k], rate);
        if (watch.needs_accelerations) chebyshev_sums(course.p_curvature, course.terms, n, s[k], curvature);
        if (watch.needs_places) chebyshev_sums(course.turned, course.turned_terms, 1, s[k], course.attitude + k);
        course.times[k] = s[k] * course.duration;
    }
    sines_cosines(at.instants * n, course.positions, course.positions, course.cosines);
    const double per_second = 1 / course.duration;
    for (std::int64_t k = 0; k < at.instants; ++k)
        for (std::int64_t i = 0; i < n; ++i) {
            const std::int64_t entry = k * n + i;
            double sine = course.amplitude[i] * course.positions[entry], cosine = course.amplitude[i] * course.cosines[entry];
            double rate = course.velocities[entry];
            course.positions[entry] = course.centre[i] + sine;
            course.velocities[entry] = per_second * cosine * rate;
            if (watch.needs_accelerations)
                course.accelerations[entry] =
                    per_second * per_second * (cosine * course.accelerations[entry] - sine * rate * rate);
        }
    watch_rates(watch, at);
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

// Local minima, lower than near but for what a row falls between two instants of the grid, and where.
static inline void watch_minima(const Watch &watch, Watched &at, const Course &course, Minima &minima) {
    constexpr int around = 17;
    const std::int64_t rows = watch.rows, count = at.instants;
    double *values = minima.values;
    follow_course(watch, at, course, minima.grid);
    watch_values(watch, at, values);
    for (std::int64_t k = 0; k < count; ++k)
        for (std::int64_t row = 0; row < rows; ++row)
            if (minima.grid[k] < minima.low[row] || minima.grid[k] > minima.high[row]) values[k * rows + row] = HUGE_VAL;
    minima.found = 0;
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
    at.wanted = minima.single;
    for (std::int64_t row = 0; row < rows; ++row) minima.single[row] = -1;
    for (std::int64_t found = 0; found < minima.found; ++found) {
        const std::int64_t row = minima.row[found];
        double &where = minima.s[found], &least = minima.least[found], value;
        double low = larger(where - minima.span, minima.low[row]), high = smaller(where + minima.span, minima.high[row]);
        at.instants = 1;
        minima.single[row] = 0;
        auto value_at = [&](double s) {
            follow_course(watch, at, course, &s);
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
        minima.single[row] = -1;
    }
}
