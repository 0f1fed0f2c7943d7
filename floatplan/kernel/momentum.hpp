// Rotation of the base over a flight, and its derivatives: planar momentum at the nodes of a grid.

// Row a of C times weighted rotations of the bodies: real and imaginary part.
template <bool is_real>
inline void Planner::couple(std::int64_t a, const double *cosine, const double *sine, std::int64_t stride, Vector &x,
                            Vector &y) const {
    const double *re = robot.real + a * bodies, *im = robot.imaginary + a * bodies;
    x = y = all(0);
    for (std::int64_t b = 0; b < bodies; ++b, cosine += stride, sine += stride) {
        Vector c = load(cosine), s = load(sine), real = all(re[b]);
        x = multiply_add(real, c, x);
        y = multiply_add(real, s, y);
        if (!is_real) {
            Vector imaginary = all(im[b]);
            x = multiply_add(-imaginary, s, x);
            y = multiply_add(imaginary, c, y);
        }
    }
}

// Integral of theta0' over [0, 1]; keeps what its derivatives need. Nodes are the inner loops: what one of them waits
// for is computed while others are.
template <bool is_real> double Planner::fly() {
    const Grid &grid = grids[level];
    const std::int64_t nodes = grid.nodes;
    const Vector per_second = all(1 / T), h = all(h0);
    for (std::int64_t i = 0; i < n; ++i) {
        const std::int64_t free = robot.free[i];
        const double *z = m.z + i * width;
        for (std::int64_t k = 0; k < nodes; k += LANES) {
            Vector p = load(m.fixed + i * nodes + k), rate = load(m.fixed_rate + i * nodes + k), s, c;
            const double *value = grid.value + 6 * nodes + k, *slope = grid.slope + 6 * nodes + k;
            for (std::int64_t f = 0; f < free; ++f, value += nodes, slope += nodes) {
                p = multiply_add(all(z[f]), load(value), p);
                rate = multiply_add(all(z[f]), load(slope), rate);
            }
            sine_cosine(p, s, c);
            store(m.sine + i * nodes + k, s);
            store(m.cosine + i * nodes + k, c);
            store(m.rate + i * nodes + k, rate);
            store(m.speed + i * nodes + k, c * rate * per_second);
        }
    }
    for (std::int64_t k = 0; k < nodes; k += LANES) {
        store(m.body_cosine + k, all(1));
        for (double *each : {m.body_sine, m.angle, m.swing}) store(each + k, all(0));
    }
    for (std::int64_t a = 1; a < bodies; ++a)
        for (std::int64_t k = 0; k < nodes; k += LANES) {
            Vector angle = load(m.angle + robot.parent[a] * nodes + k), swing = load(m.swing + robot.parent[a] * nodes + k);
            Vector s, c;
            for (std::int64_t e = robot.first[a]; e < robot.first[a + 1]; ++e) {
                Vector ratio = all(robot.ratio[e]);
                angle = multiply_add(ratio, load(m.sine + robot.joint[e] * nodes + k), angle);
                swing = multiply_add(ratio, load(m.speed + robot.joint[e] * nodes + k), swing);
            }
            sine_cosine(angle, s, c);
            store(m.angle + a * nodes + k, angle);
            store(m.swing + a * nodes + k, swing);
            store(m.body_cosine + a * nodes + k, c);
            store(m.body_sine + a * nodes + k, s);
        }
    Vector total = all(0);
    for (std::int64_t k = 0; k < nodes; k += LANES) {
        Vector locked = all(0), moving = all(0);
        for (std::int64_t a = 0; a < bodies; ++a) {
            Vector x, y;
            couple<is_real>(a, m.body_cosine + k, m.body_sine + k, nodes, x, y);
            Vector c = load(m.body_cosine + a * nodes + k), s = load(m.body_sine + a * nodes + k);
            Vector inertia = multiply_add(c, x, s * y);
            store(m.turned + a * nodes + k, multiply_add(c, y, -s * x));
            store(m.inertia + a * nodes + k, inertia);
            locked += inertia;
            moving = multiply_add(inertia, load(m.swing + a * nodes + k), moving);
        }
        Vector inverse = all(1) / locked, rate = (h - moving) * inverse;
        store(m.inverse + k, inverse);
        store(m.base_rate + k, rate);
        total = multiply_add(load(grid.weights + k), rate, total);
    }
    return sum(total);
}

// Adjoint of fly(): z_gradient, times the duration.
template <bool is_real> void Planner::backward() {
    const Grid &grid = grids[level];
    const std::int64_t nodes = grid.nodes;
    const Vector per_second = all(1 / T);
    Vector *moving_cosine = (Vector *)m.moving_cosine, *moving_sine = (Vector *)m.moving_sine;
    Vector *by_angle = (Vector *)m.by_angle, *by_swing = (Vector *)m.by_swing;
    Vector *by_sine = (Vector *)m.by_joint, *by_rate = (Vector *)m.by_joint_rate, *by_z = (Vector *)m.by_z;
    for (std::int64_t e = 0; e < n * width; ++e) by_z[e] = all(0);
    for (std::int64_t k = 0; k < nodes; k += LANES) {
        Vector minus = -all(T) * load(grid.weights + k) * load(m.inverse + k);
        Vector twice = all(2) * load(m.base_rate + k);
        for (std::int64_t a = 0; a < bodies; ++a) {
            Vector swing = load(m.swing + a * nodes + k);
            moving_cosine[a] = load(m.body_cosine + a * nodes + k) * swing;
            moving_sine[a] = load(m.body_sine + a * nodes + k) * swing;
        }
        for (std::int64_t a = 0; a < bodies; ++a) {
            Vector x, y;
            couple<is_real>(a, m.moving_cosine, m.moving_sine, LANES, x, y);
            Vector c = load(m.body_cosine + a * nodes + k), s = load(m.body_sine + a * nodes + k);
            Vector by = multiply_add(c, y, -s * x);
            by = multiply_add(load(m.swing + a * nodes + k) + twice, load(m.turned + a * nodes + k), by);
            by_angle[a] = minus * by;
            by_swing[a] = minus * load(m.inertia + a * nodes + k);
        }
        for (std::int64_t i = 0; i < n; ++i) by_sine[i] = by_rate[i] = all(0);
        for (std::int64_t a = bodies - 1; a > 0; --a) {
            by_angle[robot.parent[a]] += by_angle[a];
            by_swing[robot.parent[a]] += by_swing[a];
            for (std::int64_t e = robot.first[a]; e < robot.first[a + 1]; ++e) {
                Vector ratio = all(robot.ratio[e]);
                by_sine[robot.joint[e]] = multiply_add(ratio, by_angle[a], by_sine[robot.joint[e]]);
                by_rate[robot.joint[e]] = multiply_add(ratio, by_swing[a], by_rate[robot.joint[e]]);
            }
        }
        for (std::int64_t i = 0; i < n; ++i) {
            Vector s = load(m.sine + i * nodes + k), c = load(m.cosine + i * nodes + k);
            Vector rate = by_rate[i] * per_second;
            Vector by_p = multiply_add(by_sine[i], c, -rate * s * load(m.rate + i * nodes + k));
            rate = rate * c;
            const double *value = grid.value + 6 * nodes + k, *slope = grid.slope + 6 * nodes + k;
            for (std::int64_t f = 0; f < robot.free[i]; ++f, value += nodes, slope += nodes)
                by_z[i * width + f] =
                    multiply_add(by_p, load(value), multiply_add(rate, load(slope), by_z[i * width + f]));
        }
    }
    for (std::int64_t e = 0; e < n * width; ++e) m.z_gradient[e] = sum(by_z[e]);
}
