// Rows of constraints of a flight, and their derivatives: of searches, and of the rest of a flight that is corrected.

// What p, and as many of its derivatives as `orders` says, change by (count), times weights, added to a row; `apart` is
// from one order to the next.
static inline void add_orders(int orders, const double *weights, const double *by, Index apart,
                              Index count, double *row) {
    const double *rate = by + apart, *curvature = rate + apart, w0 = weights[0], w1 = weights[1], w2 = weights[2];
    if (orders == 0)
        add(w0, by, count, row);
    else if (orders == 1)
        for (Index c = 0; c < count; ++c) row[c] += w0 * by[c] + w1 * rate[c];
    else
        for (Index c = 0; c < count; ++c) row[c] += w0 * by[c] + w1 * rate[c] + w2 * curvature[c];
}

// Derivatives (size) of what m.by says at instant k, added to a row: by positions, and by as many of their derivatives
// as `orders` says; with these also by h.
static inline void chain(const Variables &variables, const Motion &m, Index n, Index k, int orders, double *row) {
    const Index size = variables.size, *columns = variables.columns, first = columns[n], axes = size - first;
    const double per_second = m.per_second, *by = m.by;
    for (Index i = 0; i < n; ++i) {
        const Index at = i * m.stride + k, from = columns[i];
        double sine = m.sine[at], cosine = m.cosine[at], weights[3] = {by[i] * cosine, 0, 0};
        if (orders > 0) {
            double rate = m.p_rate[at], swing = per_second * sine * rate;
            weights[0] -= by[n + i] * swing;
            weights[1] = by[n + i] * per_second * cosine;
            if (orders > 1) {
                double acceleration = by[2 * n + i] * per_second;
                weights[0] -= acceleration * per_second * (sine * m.p_curvature[at] + cosine * rate * rate);
                weights[1] -= 2 * acceleration * swing;
                weights[2] = acceleration * per_second * cosine;
            }
        }
        add_orders(orders, weights, variables.basis + k * size + from, variables.instants * size,
                   columns[i + 1] - from, row + from);
        if (variables.of_axes)
            add_orders(orders, weights, variables.of_axes + (k * n + i) * axes, variables.instants * n * axes, axes,
                       row + first);
    }
    if (orders > 0) add(by[3 * n], variables.axes, axes, row + first);
}

// Derivative (size) of theta0' at instant k, added to a row; after differentiate_turn().
static inline void chain_rate(const Variables &variables, const Motion &m, Index n, Index k, double *row) {
    for (Index i = 0; i < n; ++i) {
        m.by[i] = m.by_position[i * m.stride + k];
        m.by[n + i] = m.by_speed[i * m.stride + k];
    }
    m.by[3 * n] = m.inverse[k];
    chain(variables, m, n, k, 1, row);
}

// Ends of the capsules from an instant on, where the attitude is; `began` s since takeoff the path of the CM begins.
static inline void place(const Robot &robot, const Constraints &constraints, Motion &m, double began, Index first) {
    const Index instants = m.instants, stride = m.stride;
    const double *path = constraints.path;
    for (Index k = first; k < instants; k += LANES) {
        Vector s, c;
        sine_cosine(load(m.attitude + k), s, c);
        store(m.attitude_sine + k, s);
        store(m.attitude_cosine + k, c);
    }
    for (Index e = 0; e < 2 * constraints.capsules; ++e)
        for (Index k = first; k < instants; k += LANES) {
            Vector along = all(0), up = all(0), dt = load(m.time + k) - all(began);
            for (Index b = 0; b < robot.bodies; ++b) {
                const double re = constraints.ends_real[e * robot.bodies + b];
                const double im = constraints.ends_imaginary[e * robot.bodies + b];
                if (re == 0 && im == 0) continue;
                Vector c = load(m.body_cosine + b * stride + k), s = load(m.body_sine + b * stride + k);
                along += all(re) * c - all(im) * s;
                up += all(re) * s + all(im) * c;
            }
            Vector c = load(m.attitude_cosine + k), s = load(m.attitude_sine + k);
            store(m.end_x + e * stride + k, all(path[0]) + all(path[2]) * dt + (c * along - s * up));
            store(m.end_y + e * stride + k, all(path[1]) + all(path[3]) * dt - all(path[4] / 2) * dt * dt +
                                                all(constraints.turn) * (s * along + c * up));
        }
}

static inline Nearest nearest(const Constraints &constraints, const Motion &m, Index row, Index k) {
    auto end = [&](Index e) { return Place{m.end_x[e * m.stride + k], m.end_y[e * m.stride + k]}; };
    const Index first = constraints.first[row], second = constraints.second[row];
    const Place start = end(2 * first), stop = end(2 * first + 1);
    Nearest found;
    if (constraints.kind[row] == pair_row) {
        found = between(start, stop, end(2 * second), end(2 * second + 1));
        found.distance -= constraints.radius[first] + constraints.radius[second];
    } else {
        const double *obstacle = constraints.obstacles + 7 * second;
        found = to_obstacle(constraints.kind[row], obstacle, m.time[k], start, stop);
        found.distance -= constraints.radius[first] + obstacle[6];
    }
    return found;
}

static inline void read(const double *from, Vector &value) { value = load(from); }
static inline void read(const double *from, double &value) { value = *from; }

// A sum at one instant, or at those that are computed at once.
template <typename Number>
static inline Number sum_at(const Robot &robot, const Constraints &constraints, const Motion &m, Index sum, Index k) {
    const Index n = robot.joints;
    const double *weights = constraints.sums + sum * (2 + 2 * n + robot.links);
    Number total = Number{} + weights[0], value;
    auto add = [&](Index term, const double *values) {
        if (weights[term] == 0) return;
        read(values + k, value);
        total = add_product(weights[term], value, total);
    };
    add(1, m.rate);
    for (Index i = 0; i < n; ++i) add(2 + i, m.speed + i * m.stride);
    for (Index i = 0; i < n; ++i) add(2 + n + i, m.acceleration + i * m.stride);
    if (constraints.needs_moments)
        for (Index b = 0; b < robot.links; ++b) add(2 + 2 * n + b, m.moment + b * m.stride);
    return total;
}

// Values (stride) of a row; distances only where they are wanted.
template <typename IsWanted>
static inline void row_values(const Robot &robot, const Constraints &constraints, const Motion &m, Index row,
                              IsWanted is_wanted, double *value) {
    const Index kind = constraints.kind[row], first = constraints.first[row], second = constraints.second[row];
    if (kind <= share_row) {
        for (Index k = 0; k < m.instants; k += LANES) {
            Vector sum = sum_at<Vector>(robot, constraints, m, first, k);
            if (kind == share_row) sum = all(1) - magnitude(sum);
            if (kind == share_row && second >= 0) sum -= magnitude(sum_at<Vector>(robot, constraints, m, second, k));
            store(value + k, sum);
        }
        return;
    }
    for (Index k = 0; k < m.instants; ++k)
        if (is_wanted(k))
            value[k] = (nearest(constraints, m, row, k).distance - constraints.least[row]) * constraints.per_scale[row];
}

// Derivatives (size) of a row at instant k; those of the attitude there (size) are given.
static inline void differentiate_row(const Robot &robot, const Constraints &constraints, Motion &m,
                                     const Variables &variables, Index row, Index k,
                                     const double *attitude_slopes, double *slopes) {
    const Index n = robot.joints, bodies = robot.bodies, terms = 2 + 2 * n + robot.links;
    if (constraints.kind[row] <= share_row) {
        const double *weights = constraints.sums + constraints.first[row] * terms;
        if (constraints.kind[row] == share_row) {
            zero(m.weights, terms);
            for (Index sum : {constraints.first[row], constraints.second[row]}) {
                if (sum < 0) continue;
                const double value = sum_at<double>(robot, constraints, m, sum, k), sign = (value > 0) - (value < 0);
                add(-sign, constraints.sums + sum * terms, terms, m.weights);
            }
            weights = m.weights;
        }
        differentiate_sum(robot, m, k, weights, constraints.needs_moments);
        zero(slopes, variables.size);
        return chain(variables, m, n, k, constraints.needs_accelerations ? 2 : 1, slopes);
    }
    const Nearest found = nearest(constraints, m, row, k);
    double *by_angle = m.by_angle;
    // How fast a point of a capsule, a share along it, moves as a body turns, m/rad; along the distance.
    auto add_capsule = [&](Index capsule, double share, double sign) {
        const double c = m.attitude_cosine[k], s = m.attitude_sine[k];
        for (Index b = 0; b < bodies; ++b) {
            const Index start = 2 * capsule * bodies + b, end = start + bodies;
            const double re = (1 - share) * constraints.ends_real[start] + share * constraints.ends_real[end];
            const double im = (1 - share) * constraints.ends_imaginary[start] + share * constraints.ends_imaginary[end];
            const double own_c = m.body_cosine[b * m.stride + k], own_s = m.body_sine[b * m.stride + k];
            const double along = re * own_c - im * own_s, up = re * own_s + im * own_c;
            by_angle[b] += sign * (constraints.turn * found.direction.y * (c * along - s * up) -
                                   found.direction.x * (s * along + c * up));
        }
    };
    for (Index b = 0; b < bodies; ++b) by_angle[b] = 0;
    add_capsule(constraints.first[row], found.own, constraints.per_scale[row]);
    if (constraints.kind[row] == pair_row)
        add_capsule(constraints.second[row], found.other, -constraints.per_scale[row]);
    gather(robot, by_angle, m.by);
    for (Index c = 0; c < variables.size; ++c) slopes[c] = by_angle[0] * attitude_slopes[c];
    chain(variables, m, n, k, 0, slopes);
}

// ---- of a motion of a search, step by step

static inline void take(const double *given, Index count, const Motion &m, double *values) {
    for (Index i = 0; i < count; ++i, values += m.stride) {
        for (Index k = 0; k < m.instants; ++k) values[k] = given[k * count + i];
        for (Index k = m.instants; k < m.stride; ++k) values[k] = 0;
    }
}

static inline void evaluate_rates(const Robot &robot, Evaluation &at) {
    take(at.positions, robot.joints, at.motion, at.motion.position);
    take(at.velocities, robot.joints, at.motion, at.motion.speed);
    turn(robot, at.motion, at.momentum);
    differentiate_turn(robot, at.motion);
}

// Values of the rows, each where at.target (instants, rows) says.
static inline void evaluate_rows(const Robot &robot, const Constraints &constraints, Evaluation &at, double *values) {
    Motion &m = at.motion;
    if (constraints.needs_accelerations) take(at.accelerations, robot.joints, m, m.acceleration);
    if (constraints.needs_moments) move_bodies(robot, m);
    if (constraints.needs_places) {
        take(at.times, 1, m, m.time);
        take(at.attitude, 1, m, m.attitude);
        place(robot, constraints, m, 0, 0);
    }
    for (Index row = 0; row < constraints.rows; ++row) {
        const Index *target = at.target + row;
        auto is_wanted = [&](Index k) { return target[k * constraints.rows] >= 0; };
        row_values(robot, constraints, m, row, is_wanted, m.value);
        for (Index k = 0; k < m.instants; ++k, target += constraints.rows)
            if (*target >= 0) values[*target] = m.value[k] - at.back_off;
    }
}

// Derivatives (instants, size) by x of theta0', at so many of the first instants.
static inline void evaluate_drift(const Robot &robot, Evaluation &at, Index instants, double *drift) {
    Motion &m = at.motion;
    take(at.sine, robot.joints, m, m.sine);
    take(at.cosine, robot.joints, m, m.cosine);
    take(at.p_rate, robot.joints, m, m.p_rate);
    if (at.p_curvature) take(at.p_curvature, robot.joints, m, m.p_curvature);
    zero(drift, instants * at.variables.size);
    for (Index k = 0; k < instants; ++k) chain_rate(at.variables, m, robot.joints, k, drift + k * at.variables.size);
}

// Derivatives (.., size) of the rows, each where at.target says; after values and drift of the same motion.
static inline void evaluate_jacobian(const Robot &robot, const Constraints &constraints, Evaluation &at,
                                     double *jacobian) {
    for (Index k = 0; k < at.motion.instants; ++k) {
        const Index *target = at.target + k * constraints.rows;
        const double *attitude = at.attitude_slopes + k * at.variables.size;
        for (Index row = 0; row < constraints.rows; ++row) {
            if (target[row] < 0) continue;
            double *slopes = jacobian + target[row] * at.variables.size;
            const Index opposite = constraints.opposite[row];
            if (opposite < 0 || target[opposite] < 0) {
                differentiate_row(robot, constraints, at.motion, at.variables, row, k, attitude, slopes);
                continue;
            }
            const double *other = jacobian + target[opposite] * at.variables.size;
            for (Index c = 0; c < at.variables.size; ++c) slopes[c] = -other[c];
        }
    }
}

// Gradient (size) of sums with weights (instants, terms), together.
static inline void evaluate_gradient(const Robot &robot, const Constraints &constraints, Evaluation &at,
                                     const double *weights, Index instants, double *gradient) {
    const Index n = robot.joints, terms = 2 + 2 * n + robot.links;
    zero(gradient, at.variables.size);
    for (Index k = 0; k < instants; ++k, weights += terms) {
        differentiate_sum(robot, at.motion, k, weights, constraints.needs_moments);
        chain(at.variables, at.motion, n, k, constraints.needs_accelerations ? 2 : 1, gradient);
    }
}
