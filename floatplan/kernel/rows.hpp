// Rows of constraints of a flight, and their derivatives: of searches, and of the rest of a flight that is corrected.

// Adds what p, and as many of its derivatives as `orders` says, change by times weights, at the instants that are computed
// at once; both are so far apart from one of `count` variables to the next, and `between` orders.
static inline void add_orders(int orders, const Vector *weights, const double *by, Index stride, Index between,
                              Index count, double *slopes, Index apart) {
    for (Index c = 0; c < count; ++c, by += stride, slopes += apart) {
        Vector slope = multiply_add(weights[0], load(by), load(slopes));
        if (orders > 0) slope = multiply_add(weights[1], load(by + between), slope);
        if (orders > 1) slope = multiply_add(weights[2], load(by + 2 * between), slope);
        store(slopes, slope);
    }
}

// Derivatives (size), `apart` from one another, of what `by` says at the instants from k on that are computed at once, added:
// by positions (n), and by as many of their derivatives as `orders` says.
static inline void chain_joints(const Variables &variables, const Motion &m, Index n, Index k, int orders, const Vector *by,
                                double *slopes, Index apart) {
    const Index size = variables.size, *columns = variables.columns, first = columns[n], axes = size - first;
    const Index stride = variables.stride;
    const Vector per_second = all(m.per_second);
    for (Index i = 0; i < n; ++i) {
        const Index at = i * m.stride + k, from = columns[i];
        const Vector sine = load(m.sine + at), cosine = load(m.cosine + at);
        Vector weights[3] = {by[i] * cosine, all(0), all(0)};
        if (orders > 0) {
            const Vector rate = load(m.p_rate + at), swing = per_second * sine * rate;
            weights[0] -= by[n + i] * swing;
            weights[1] = by[n + i] * per_second * cosine;
            if (orders > 1) {
                const Vector acceleration = by[2 * n + i] * per_second;
                weights[0] -= acceleration * per_second * (sine * load(m.p_curvature + at) + cosine * rate * rate);
                weights[1] -= all(2) * acceleration * swing;
                weights[2] = acceleration * per_second * cosine;
            }
        }
        add_orders(orders, weights, variables.basis + from * stride + k, stride, size * stride, columns[i + 1] - from,
                   slopes + from * apart, apart);
        if (variables.of_axes)
            add_orders(orders, weights, variables.of_axes + i * axes * stride + k, stride, n * axes * stride, axes,
                       slopes + first * apart, apart);
    }
}

// The same of what m.by says, with derivatives also by h.
static inline void chain(const Variables &variables, const Motion &m, Index n, Index k, int orders, double *slopes,
                         Index apart) {
    const Vector *by = (const Vector *)m.by;
    chain_joints(variables, m, n, k, orders, by, slopes, apart);
    const Index first = variables.columns[n];
    for (Index axis = 0; orders > 0 && axis < variables.size - first; ++axis) {
        double *slope = slopes + (first + axis) * apart;
        store(slope, add_product(variables.axes[axis], by[3 * n], load(slope)));
    }
}

// Derivatives (size, ..) of theta0' at the instants from k on, of a whole stride; after differentiate_base_rate().
static inline void chain_rate(const Variables &variables, const Motion &m, Index n, Index k, double *drift,
                              Index stride) {
    Vector *by = (Vector *)m.by;
    for (Index i = 0; i < n; ++i) {
        by[i] = load(m.by_position + i * m.stride + k);
        by[n + i] = load(m.by_speed + i * m.stride + k);
    }
    by[3 * n] = load(m.inverse + k);
    for (Index c = 0; c < variables.size; ++c) store(drift + c * stride + k, all(0));
    chain(variables, m, n, k, 1, drift + k, stride);
}

// In the plane, ends of the capsules from an instant on, where the attitude is; `began` s since takeoff the path of the CM begins.
static inline void place(const Robot &robot, const Constraints &constraints, Motion &m, double began, Index first) {
    const Index instants = m.instants, stride = m.stride, bodies = robot.bodies;
    const double *path = constraints.path;
    // From the CM at orientation 0, each from the one before: most of their weights are the same.
    for (Index e = 0; e < 2 * constraints.capsules; ++e) {
        double *along = m.end_x + e * stride, *up = m.end_y + e * stride;
        for (double *each : {along, up})
            for (Index k = first; k < instants; k += LANES) store(each + k, e ? load(each + k - stride) : all(0));
        const double *real = constraints.ends_real + e * bodies, *imaginary = constraints.ends_imaginary + e * bodies;
        for (Index b = 0; b < bodies; ++b) {
            const double re = real[b] - (e ? real[b - bodies] : 0), im = imaginary[b] - (e ? imaginary[b - bodies] : 0);
            if (re == 0 && im == 0) continue;
            for (Index k = first; k < instants; k += LANES) {
                const Vector c = load(m.body_cosine + b * stride + k), s = load(m.body_sine + b * stride + k);
                store(along + k, load(along + k) + (all(re) * c - all(im) * s));
                store(up + k, load(up + k) + (all(re) * s + all(im) * c));
            }
        }
    }
    for (Index k = first; k < instants; k += LANES) {
        Vector s, c, dt = load(m.time + k) - all(began);
        sine_cosine(load(m.attitude + k), s, c);
        store(m.attitude_sine + k, s);
        store(m.attitude_cosine + k, c);
        const Vector x = all(path[0]) + all(path[2]) * dt;
        const Vector y = all(path[1]) + all(path[3]) * dt - all(path[4] / 2) * dt * dt;
        for (Index e = 0; e < 2 * constraints.capsules; ++e) {
            const Vector along = load(m.end_x + e * stride + k), up = load(m.end_y + e * stride + k);
            store(m.end_x + e * stride + k, x + (c * along - s * up));
            store(m.end_y + e * stride + k, y + all(constraints.turn) * (s * along + c * up));
        }
    }
}

// An end of a capsule at the instants computed at once.
template <typename P> INLINED P end_of(const Motion &m, Index end, Index k) {
    const Index at = end * m.stride + k;
    if constexpr (dimensions<P> == 2) return {load(m.end_x + at), load(m.end_y + at)};
    else return {load(m.end_x + at), load(m.end_y + at), load(m.end_z + at)};
}

// The longest way of an end of a capsule from one of so many instants to the next, m.
template <typename P> static inline double longest_way_of_ends(const Constraints &constraints, const Motion &m, Index instants) {
    const double *const coordinates[] = {m.end_x, m.end_y, m.end_z};
    double most = 0;
    for (Index end = 0; end < 2 * (constraints.capsules - constraints.hulls); ++end) {
        double way = 0;
        for (Index k = 1; k < instants; ++k) {
            const auto moved = [&](Index axis) {
                const double *at = coordinates[axis] + end * m.stride + k;
                return at[0] - at[-1];
            };
            way += dimensions<P> == 2 ? std::hypot(moved(0), moved(1)) : std::hypot(moved(0), moved(1), moved(2));
        }
        most = larger(most, way);
    }
    return most;
}

template <typename P> INLINED Nearest<P> nearest(const Constraints &constraints, const Motion &m, Index row, Index k) {
    constexpr Index numbers = obstacle_numbers<P>;
    const Index first = constraints.first[row], second = constraints.second[row];
    const bool is_pair = constraints.kind[row] == pair_row;
    const double *obstacle = constraints.obstacles + (is_pair ? 0 : numbers * second);
    const P start = end_of<P>(m, 2 * first, k), stop = end_of<P>(m, 2 * first + 1, k);
    Nearest<P> found = is_pair ? between(start, stop, end_of<P>(m, 2 * second, k), end_of<P>(m, 2 * second + 1, k))
                               : to_obstacle(constraints.kind[row], obstacle, load(m.time + k), start, stop);
    found.distance -= all(constraints.radius[first] + (is_pair ? constraints.radius[second] : obstacle[numbers - 1]));
    return found;
}

// What sums are of: a constant, the base's rate, velocities and accelerations of joints, moments or torques of links.
struct Terms {
    Index joints, links;

    Index count() const { return 2 + 2 * joints + links; }
};

static inline Terms terms_of(const Robot &robot) { return {robot.joints, robot.links}; }

// Values of a sum at the instants from one on, until another.
static inline void sum_values(Terms terms, const Constraints &constraints, const Motion &m, Index sum, Index from, Index to,
                              double *value) {
    const Index n = terms.joints;
    const double *weights = constraints.sums + sum * terms.count();
    for (Index k = from; k < to; k += LANES) store(value + k - from, all(weights[0]));
    auto add = [&](Index term, const double *values) {
        if (weights[term] == 0) return;
        const Vector weight = all(weights[term]);
        for (Index k = from; k < to; k += LANES)
            store(value + k - from, multiply_add(weight, load(values + k), load(value + k - from)));
    };
    add(1, m.rate);
    for (Index i = 0; i < n; ++i) add(2 + i, m.speed + i * m.stride);
    for (Index i = 0; i < n; ++i) add(2 + n + i, m.acceleration + i * m.stride);
    if (constraints.needs_moments)
        for (Index b = 0; b < terms.links; ++b) add(2 + 2 * n + b, m.moment + b * m.stride);
}

static inline Vector sum_at(Terms terms, const Constraints &constraints, const Motion &m, Index sum, Index k) {
    double value[LANES];
    sum_values(terms, constraints, m, sum, k, k + LANES, value);
    return load(value);
}

// Values of a row of sums at the instants from one on, until another.
static inline void limit_values(Terms terms, const Constraints &constraints, const Motion &m, Index row, Index from,
                                Index to, double *value) {
    const Index kind = constraints.kind[row], second = constraints.second[row];
    sum_values(terms, constraints, m, constraints.first[row], from, to, value);
    for (Index k = from; kind == share_row && k < to; k += LANES) {
        const Vector left = all(1) - magnitude(load(value + k - from));
        store(value + k - from, second < 0 ? left : left - magnitude(sum_at(terms, constraints, m, second, k)));
    }
}

// Values of one of opposite derivatives to those of another row, which are known: the sum of both is constant.
static inline void opposite_values(Terms terms, const Constraints &constraints, const Motion &m, Index row, double *values) {
    const Index opposite = constraints.opposite[row];
    const double *known = values + opposite * m.stride, *sums = constraints.sums;
    double *value = values + row * m.stride;
    const Vector both = all(sums[constraints.first[row] * terms.count()] + sums[constraints.first[opposite] * terms.count()]);
    for (Index k = 0; k < m.instants; k += LANES) store(value + k, both - load(known + k));
}

// By how much a row of sums changes with each of their terms (terms), at the instants that are computed at once.
static inline void limit_weights(Terms terms, const Constraints &constraints, const Motion &m, Index row, Index k,
                                 Vector *weights) {
    for (Index term = 0; term < terms.count(); ++term) weights[term] = all(0);
    for (Index sum : {constraints.first[row], constraints.second[row]}) {
        if (sum < 0 || (sum != constraints.first[row] && constraints.kind[row] == sum_row)) continue;
        const double *own = constraints.sums + sum * terms.count();
        Vector sign = all(1);
        if (constraints.kind[row] == share_row) {
            const Vector value = sum_at(terms, constraints, m, sum, k);
            sign = select(value > all(0), all(-1), select(value < all(0), all(1), all(0)));
        }
        for (Index term = 0; term < terms.count(); ++term) weights[term] = add_product(own[term], sign, weights[term]);
    }
}

// Values of a row at the instants from one on, until another. P is a point where the robot flies: a Place, or Threes.
template <typename P>
static inline void row_values(Terms terms, const Constraints &constraints, const Motion &m, Index row, Index from, Index to,
                              double *value) {
    const Index kind = constraints.kind[row];
    const Vector margin = all(constraints.margin[row]), per_scale = all(constraints.per_scale[row]);
    for (Index k = from; kind > share_row && k < to; k += LANES)
        store(value + k - from, (nearest<P>(constraints, m, row, k).distance - margin) * per_scale);
    if (kind <= share_row) limit_values(terms, constraints, m, row, from, to, value);
}

// Values (instants) of one of the rows (rows, stride) after those before it.
template <typename P>
static inline void next_values(Terms terms, const Constraints &constraints, const Motion &m, Index row, double *values) {
    if (constraints.opposite[row] >= 0) return opposite_values(terms, constraints, m, row, values);
    row_values<P>(terms, constraints, m, row, 0, m.instants, values + row * m.stride);
}

// Derivatives (size, 8) of a row of a flight in the plane at the 8 instants about k, those from k on that are computed at
// once; those (size), so far apart, of the attitude there are given.
static inline void differentiate_row(const Robot &robot, const Constraints &constraints, Motion &m,
                                     const Variables &variables, Index row, Index k,
                                     const double *attitude_slopes, Index apart, double *pack) {
    const Index n = robot.joints, bodies = robot.bodies;
    double *slopes = pack + k % 8;
    if (constraints.kind[row] <= share_row) {
        Vector *weights = (Vector *)m.weights;
        limit_weights(terms_of(robot), constraints, m, row, k, weights);
        differentiate_sum(robot, m, k, weights, constraints.needs_moments);
        for (Index c = 0; c < variables.size; ++c) store(slopes + 8 * c, all(0));
        return chain(variables, m, n, k, constraints.needs_accelerations ? 2 : 1, slopes, 8);
    }
    const Nearest<Place> found = nearest<Place>(constraints, m, row, k);
    const Vector c = load(m.attitude_cosine + k), s = load(m.attitude_sine + k);
    Vector *by_angle = (Vector *)m.by_angle, *by = (Vector *)m.by;
    // How fast a point of a capsule, a share along it, moves as a body turns, m/rad; along the distance.
    auto add_capsule = [&](Index capsule, Vector fraction, double sign) {
        const double *re = constraints.ends_real + 2 * capsule * bodies;
        const double *im = constraints.ends_imaginary + 2 * capsule * bodies;
        for (Index b = 0; b < bodies; ++b) {
            const Index end = b + bodies;
            if (re[b] == 0 && re[end] == 0 && im[b] == 0 && im[end] == 0) continue;
            const Vector at_re = all(re[b]) + fraction * all(re[end] - re[b]);
            const Vector at_im = all(im[b]) + fraction * all(im[end] - im[b]);
            const Vector own_c = load(m.body_cosine + b * m.stride + k), own_s = load(m.body_sine + b * m.stride + k);
            const Vector along = at_re * own_c - at_im * own_s, up = at_re * own_s + at_im * own_c;
            by_angle[b] += all(sign) * (all(constraints.turn) * found.direction.y * (c * along - s * up) -
                                        found.direction.x * (s * along + c * up));
        }
    };
    for (Index b = 0; b < bodies; ++b) by_angle[b] = all(0);
    add_capsule(constraints.first[row], found.own, constraints.per_scale[row]);
    if (constraints.kind[row] == pair_row)
        add_capsule(constraints.second[row], found.other, -constraints.per_scale[row]);
    gather(robot, by_angle, by);
    for (Index x = 0; x < variables.size; ++x)
        store(slopes + 8 * x, by_angle[0] * load(attitude_slopes + x * apart));
    chain(variables, m, n, k, 0, slopes, 8);
}
