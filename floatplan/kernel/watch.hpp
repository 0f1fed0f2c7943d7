// Rows that are watched during a flight: distances, and sums of the moments and rates.
//
// The same as floatplan/motion/planar/closed_form.py and clearance.py, instant by instant.

// Places what is kept of a motion, of whose rows so many are wanted, one after the other in an arena.
static inline void watch_room(Arena &arena, const Watch &watch, Watched &at, std::int64_t wanted) {
    const std::int64_t n = watch.joints, m = watch.bodies, instants = at.instants;
    for (double **each : {&at.rate, &at.by_momentum, &at.base_acceleration, &at.turned_sine, &at.turned_cosine})
        arena.take(*each, instants);
    for (double **each : {&at.by_velocity, &at.by_position}) arena.take(*each, instants * n);
    for (double **each : {&at.real, &at.imaginary, &at.turned_real, &at.turned_imaginary, &at.moments})
        arena.take(*each, instants * m);
    arena.take(at.ends, instants * watch.capsules * 4);
    arena.take(at.nearest, wanted * 4);
    arena.take(at.scratch, (m + 2) * (3 * n + 1) + 4 * m);
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
    const double *obstacle = watch.obstacles + 7 * second;
    Nearest found = to_obstacle(watch.kind[row], obstacle, at.times[k], end(2 * first), end(2 * first + 1));
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
