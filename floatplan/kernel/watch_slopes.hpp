// Derivatives of the rows of watch.hpp.

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
