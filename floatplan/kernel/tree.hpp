// How a planar tree turns: its momentum, the moments that turn its links, and what both change by, at many instants at
// once. Plain plans, rows of constraints, peaks and corrections in flight all take it from here.
//
// E_a = exp(i angle_a) is the rotation of body a at orientation 0, inertia_a + i turned_a = conj(E_a) sum_b C_ab E_b.
// By (4) theta0' = (h - sum_a inertia_a swing_a) / D_0, D_0 = sum_a inertia_a;
// see floatplan/motion/planar/closed_form.py.

static inline Vector add_product(double factor, Vector value, Vector sum) {
    return multiply_add(all(factor), value, sum);
}
static inline double add_product(double factor, double value, double sum) { return sum + factor * value; }

// A row of C (bodies) times rotations of the bodies, weighted or not: real and imaginary part.
template <bool is_real>
static inline void couple(const double *re, const double *im, Index bodies, const double *cosine,
                          const double *sine, Index stride, Vector &x, Vector &y) {
    x = y = all(0);
    for (Index b = 0; b < bodies; ++b, cosine += stride, sine += stride) {
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

// Takes what something changes by with the bodies (bodies) to the joints (joints); by[0] is then what the base does.
template <typename Number>
static inline void gather(const Robot &robot, Number *by, Number *by_joint) {
    for (Index i = 0; i < robot.joints; ++i) by_joint[i] = Number{};
    for (Index a = robot.bodies - 1; a > 0; --a) {
        by[robot.parent[a]] += by[a];
        for (Index e = robot.first[a]; e < robot.first[a + 1]; ++e)
            by_joint[robot.joint[e]] = add_product(robot.ratio[e], by[a], by_joint[robot.joint[e]]);
    }
}

// theta0' and what it needs, from joints at `position` that move with m.speed. Instants are the inner loops: what one
// of them waits for is computed while others are.
template <bool is_real>
static inline void compute_base_rate(const Robot &robot, Motion &m, const double *position, double momentum) {
    const Index instants = m.instants, stride = m.stride, bodies = robot.bodies;
    const Vector h = all(momentum);
    for (Index k = 0; k < instants; k += LANES) {
        store(m.body_cosine + k, all(1));
        for (double *each : {m.body_sine, m.angle, m.swing}) store(each + k, all(0));
    }
    for (Index a = 1; a < bodies; ++a)
        for (Index k = 0; k < instants; k += LANES) {
            Vector angle = load(m.angle + robot.parent[a] * stride + k);
            Vector swing = load(m.swing + robot.parent[a] * stride + k), s, c;
            for (Index e = robot.first[a]; e < robot.first[a + 1]; ++e) {
                angle = add_product(robot.ratio[e], load(position + robot.joint[e] * stride + k), angle);
                swing = add_product(robot.ratio[e], load(m.speed + robot.joint[e] * stride + k), swing);
            }
            sine_cosine(angle, s, c);
            store(m.angle + a * stride + k, angle);
            store(m.swing + a * stride + k, swing);
            store(m.body_cosine + a * stride + k, c);
            store(m.body_sine + a * stride + k, s);
        }
    for (Index k = 0; k < instants; k += LANES) {
        Vector locked = all(0), moving = all(0);
        for (Index a = 0; a < bodies; ++a) {
            Vector x, y;
            couple<is_real>(robot.real + a * bodies, robot.imaginary + a * bodies, bodies, m.body_cosine + k,
                            m.body_sine + k, stride, x, y);
            Vector c = load(m.body_cosine + a * stride + k), s = load(m.body_sine + a * stride + k);
            Vector inertia = multiply_add(c, x, s * y);
            store(m.turned + a * stride + k, multiply_add(c, y, -s * x));
            store(m.inertia + a * stride + k, inertia);
            locked += inertia;
            moving = multiply_add(inertia, load(m.swing + a * stride + k), moving);
        }
        Vector inverse = all(1) / locked;
        store(m.inverse + k, inverse);
        store(m.rate + k, (h - moving) * inverse);
    }
}

static inline void compute_base_rate(const Robot &robot, Motion &m, double momentum) {
    robot.is_real ? compute_base_rate<true>(robot, m, m.position, momentum)
                  : compute_base_rate<false>(robot, m, m.position, momentum);
}

// What theta0' changes by with the positions and speeds of the joints, in m.by_joint and m.by_joint_rate, at the
// instants from k on that are computed at once; times -factor D_0.
template <bool is_real>
static inline void differentiate_base_rate(const Robot &robot, Motion &m, Index k, Vector factor) {
    const Index bodies = robot.bodies, stride = m.stride;
    Vector *moving_cosine = (Vector *)m.moving_cosine, *moving_sine = (Vector *)m.moving_sine;
    Vector *by_angle = (Vector *)m.by_angle, *by_swing = (Vector *)m.by_swing;
    Vector twice = all(2) * load(m.rate + k);
    for (Index a = 0; a < bodies; ++a) {
        Vector swing = load(m.swing + a * stride + k);
        moving_cosine[a] = load(m.body_cosine + a * stride + k) * swing;
        moving_sine[a] = load(m.body_sine + a * stride + k) * swing;
    }
    for (Index a = 0; a < bodies; ++a) {
        Vector x, y;
        couple<is_real>(robot.real + a * bodies, robot.imaginary + a * bodies, bodies, m.moving_cosine, m.moving_sine,
                        LANES, x, y);
        Vector c = load(m.body_cosine + a * stride + k), s = load(m.body_sine + a * stride + k);
        Vector by = multiply_add(c, y, -s * x);
        by = multiply_add(load(m.swing + a * stride + k) + twice, load(m.turned + a * stride + k), by);
        by_angle[a] = factor * by;
        by_swing[a] = factor * load(m.inertia + a * stride + k);
    }
    gather(robot, by_angle, (Vector *)m.by_joint);
    gather(robot, by_swing, (Vector *)m.by_joint_rate);
}

// Derivatives of theta0' by positions and speeds, at all instants.
static inline void differentiate_base_rate(const Robot &robot, Motion &m) {
    for (Index k = 0; k < m.instants; k += LANES) {
        Vector factor = -load(m.inverse + k);
        robot.is_real ? differentiate_base_rate<true>(robot, m, k, factor) : differentiate_base_rate<false>(robot, m, k, factor);
        for (Index i = 0; i < robot.joints; ++i) {
            store(m.by_position + i * m.stride + k, ((Vector *)m.by_joint)[i]);
            store(m.by_speed + i * m.stride + k, ((Vector *)m.by_joint_rate)[i]);
        }
    }
}

// Adds what turns the motors' rotors to the moments at the instants from k on.
static inline void turn_rotors(const Robot &robot, Motion &m, Index k) {
    for (Index link = 0; link < robot.links; ++link)
        for (Index i = 0; i < robot.joints; ++i) {
            const double rotor = robot.rotors[link * robot.joints + i];
            double *moment = m.moment + link * m.stride + k;
            if (rotor != 0) store(moment, add_product(rotor, load(m.acceleration + i * m.stride + k), load(moment)));
        }
}

// theta0'' and the moments that turn the links, from m.acceleration; their sum vanishes. x + i y is E_a (phi_a'' + i
// phi_a'^2); moment + i gathered is conj(E_b) sum_o C_bo (x_o + i y_o), rotors left out.
static inline void move_bodies(const Robot &robot, Motion &m) {
    const Index bodies = robot.bodies, stride = m.stride;
    for (Index k = 0; k < m.instants; k += LANES) {
        Vector base_rate = load(m.rate + k), pull = all(0);
        for (Index a = 0; a < bodies; ++a) {
            Vector relative = a ? load(m.relative + robot.parent[a] * stride + k) : all(0);
            Vector rate = load(m.swing + a * stride + k) + base_rate;
            for (Index e = robot.first[a]; e < robot.first[a + 1]; ++e)
                relative = add_product(robot.ratio[e], load(m.acceleration + robot.joint[e] * stride + k), relative);
            store(m.relative + a * stride + k, relative);
            store(m.y + a * stride + k, rate * rate);
            pull = multiply_add(load(m.inertia + a * stride + k), relative, pull);
            pull = multiply_add(load(m.turned + a * stride + k), rate * rate, pull);
        }
        Vector base_acceleration = -pull * load(m.inverse + k);
        store(m.base_acceleration + k, base_acceleration);
        for (Index a = 0; a < bodies; ++a) {
            Vector c = load(m.body_cosine + a * stride + k), s = load(m.body_sine + a * stride + k);
            Vector x = load(m.relative + a * stride + k) + base_acceleration, y = load(m.y + a * stride + k);
            store(m.x + a * stride + k, c * x - s * y);
            store(m.y + a * stride + k, s * x + c * y);
        }
        for (Index link = 0; link < robot.links; ++link) {
            Vector x, y;
            couple<false>(robot.link_real + link * bodies, robot.link_imaginary + link * bodies, bodies, m.x + k,
                          m.y + k, stride, x, y);
            const Index own = robot.group[link] * stride + k;
            Vector c = load(m.body_cosine + own), s = load(m.body_sine + own);
            store(m.moment + link * stride + k, multiply_add(c, x, s * y));
            store(m.gathered + link * stride + k, multiply_add(c, y, -s * x));
        }
        if (robot.has_rotors) turn_rotors(robot, m, k);
    }
}

// Derivatives by position, speed and acceleration of the joints and by h, m.by (3 joints + 1), at the instants from k on
// that are computed at once, of a sum: weights (terms) of 1, theta0', velocities, accelerations and, where it has some,
// moments. After differentiate_base_rate(). As the moments sum up to nothing, what the base's acceleration does to the sum is
// taken off their weights.
static inline void differentiate_sum(const Robot &robot, Motion &m, Index k, const Vector *weights, bool moments) {
    const Index n = robot.joints, bodies = robot.bodies, stride = m.stride;
    const Vector none = all(0), *of_moments = weights + 2 + 2 * n;
    Vector *by = (Vector *)m.by, by_base_rate = weights[1];
    for (Index i = 0; i < 3 * n; ++i) by[i] = none;
    if (moments) {
        Vector *by_angle = (Vector *)m.by_angle, *by_swing = (Vector *)m.by_swing;
        Vector *by_acceleration = (Vector *)m.moving_cosine, pulled = none;
        for (Index o = 0; o < bodies; ++o) by_angle[o] = by_swing[o] = by_acceleration[o] = none;
        for (Index b = 0; b < robot.links; ++b) {  // sum_b weight_b conj(E_b) C_bo
            if (!any(of_moments[b] != none)) continue;
            const double *re = robot.link_real + b * bodies, *im = robot.link_imaginary + b * bodies;
            const Vector c = of_moments[b] * load(m.body_cosine + robot.group[b] * stride + k);
            const Vector s = of_moments[b] * load(m.body_sine + robot.group[b] * stride + k);
            for (Index o = 0; o < bodies; ++o) {
                by_acceleration[o] = add_product(re[o], c, add_product(im[o], s, by_acceleration[o]));
                by_swing[o] = add_product(im[o], c, add_product(-re[o], s, by_swing[o]));
            }
        }
        for (Index o = 0; o < bodies; ++o) {
            const Vector c = load(m.body_cosine + o * stride + k), s = load(m.body_sine + o * stride + k);
            const Vector x = by_acceleration[o];
            by_acceleration[o] = multiply_add(x, c, -by_swing[o] * s);
            by_swing[o] = multiply_add(x, s, by_swing[o] * c);
            pulled += by_acceleration[o];
        }
        pulled *= load(m.inverse + k);
        for (Index b = 0; b < robot.links; ++b)
            by_angle[robot.group[b]] =
                multiply_add(of_moments[b] - pulled, load(m.gathered + b * stride + k), by_angle[robot.group[b]]);
        for (Index o = 0; o < bodies; ++o) {
            const Index at = o * stride + k;
            const Vector real = by_acceleration[o] - pulled * load(m.inertia + at);
            const Vector imaginary = by_swing[o] + pulled * load(m.turned + at);
            const Vector rate = load(m.swing + at) + load(m.rate + k);
            by_angle[o] -= real * rate * rate + imaginary * (load(m.relative + at) + load(m.base_acceleration + k));
            by_swing[o] = all(-2) * imaginary * rate;
            by_acceleration[o] = real;
        }
        gather(robot, by_angle, by);
        gather(robot, by_swing, by + n);
        gather(robot, by_acceleration, by + 2 * n);
        for (Index e = 0; robot.has_rotors && e < robot.links * n; ++e)
            by[2 * n + e % n] = add_product(robot.rotors[e], of_moments[e / n], by[2 * n + e % n]);
        by_base_rate += by_swing[0];
    }
    for (Index i = 0; i < n; ++i) {
        by[i] = multiply_add(by_base_rate, load(m.by_position + i * stride + k), by[i]);
        by[n + i] = multiply_add(by_base_rate, load(m.by_speed + i * stride + k), by[n + i]) + weights[2 + i];
        by[2 * n + i] += weights[2 + n + i];
    }
    by[3 * n] = by_base_rate * load(m.inverse + k);
}

// The torque of a motor at the instants from k on that are computed at once; it turns link b by turns[b * motors].
static inline Vector motor_torque(Index links, const Motion &m, const double *turns, Index motors, Index k) {
    Vector torque = all(0);
    for (Index link = 0; link < links; ++link)
        if (turns[link * motors] != 0)
            torque = add_product(turns[link * motors], load(m.moment + link * m.stride + k), torque);
    return torque;
}

// p of n joints and its derivatives in m.sine, m.p_rate and m.p_curvature: sums of functions, with coefficients
// (columns, n), from the functions' values and derivatives (columns, stride).
static inline void combine(Motion &m, Index n, const double *coefficients, Index columns,
                           const double *value, const double *first, const double *second) {
    for (Index i = 0; i < n; ++i)
        for (Index k = 0; k < m.instants; k += LANES) {
            Vector p = all(0), rate = all(0), curvature = all(0);
            for (Index c = 0; c < columns; ++c) {
                const double z = coefficients[c * n + i];
                p = add_product(z, load(value + c * m.stride + k), p);
                rate = add_product(z, load(first + c * m.stride + k), rate);
                curvature = add_product(z, load(second + c * m.stride + k), curvature);
            }
            store(m.sine + i * m.stride + k, p);
            store(m.p_rate + i * m.stride + k, rate);
            store(m.p_curvature + i * m.stride + k, curvature);
        }
}

// Joints that swing as centre + amplitude sin p: m.sine holds p, m.p_rate and m.p_curvature its derivatives.
static inline void swing_joints(Index n, Motion &m, const double *centre, const double *amplitude) {
    const Vector per_second = all(m.per_second);
    for (Index i = 0; i < n; ++i)
        for (Index k = 0; k < m.instants; k += LANES) {
            const Index at = i * m.stride + k;
            Vector s, c, rate = load(m.p_rate + at);
            sine_cosine(load(m.sine + at), s, c);
            s = all(amplitude[i]) * s;
            c = all(amplitude[i]) * c;
            store(m.sine + at, s);
            store(m.cosine + at, c);
            store(m.position + at, all(centre[i]) + s);
            store(m.speed + at, per_second * c * rate);
            store(m.acceleration + at, per_second * per_second * (c * load(m.p_curvature + at) - s * rate * rate));
        }
}

// p and its derivative (2, n, stride) of the first columns of a basis, with coefficients (n, columns).
static inline void combine_first(const Motion &m, Index n, const double *coefficients, Index columns, const double *value,
                                 const double *first, double *result) {
    for (Index i = 0; i < n; ++i)
        for (Index k = 0; k < m.instants; k += LANES) {
            Vector p = all(0), rate = all(0);
            for (Index c = 0; c < columns; ++c) {
                p = add_product(coefficients[i * columns + c], load(value + c * m.stride + k), p);
                rate = add_product(coefficients[i * columns + c], load(first + c * m.stride + k), rate);
            }
            store(result + i * m.stride + k, p);
            store(result + (n + i) * m.stride + k, rate);
        }
}

// Positions and speeds alone of joints that swing, whose p is that of some columns (2, n, stride) and of the others, with
// coefficients (others, n).
static inline void swing_joints(Index n, Motion &m, const double *of_first, const double *coefficients, Index others,
                                const double *value, const double *first, const double *centre, const double *amplitude) {
    const Vector per_second = all(m.per_second);
    for (Index i = 0; i < n; ++i)
        for (Index k = 0; k < m.instants; k += LANES) {
            const Index at = i * m.stride + k;
            Vector s, c, p = load(of_first + at), rate = load(of_first + n * m.stride + at);
            for (Index other = 0; other < others; ++other) {
                p = add_product(coefficients[other * n + i], load(value + other * m.stride + k), p);
                rate = add_product(coefficients[other * n + i], load(first + other * m.stride + k), rate);
            }
            sine_cosine(p, s, c);
            s = all(amplitude[i]) * s;
            c = all(amplitude[i]) * c;
            store(m.sine + at, s);
            store(m.cosine + at, c);
            store(m.p_rate + at, rate);
            store(m.position + at, all(centre[i]) + s);
            store(m.speed + at, per_second * c * rate);
        }
}

static inline void lay_out_turn(Arena &arena, Motion &m, const Robot &robot, Index instants) {
    const Index n = robot.joints, bodies = robot.bodies;
    m.instants = instants;
    m.stride = (instants + 7) / 8 * 8;
    for (double **each : {&m.sine, &m.cosine, &m.p_rate, &m.speed}) arena.take(*each, n * m.stride);
    for (double **each : {&m.body_cosine, &m.body_sine, &m.turned, &m.inertia, &m.swing, &m.angle})
        arena.take(*each, bodies * m.stride);
    for (double **each : {&m.rate, &m.inverse}) arena.take(*each, m.stride);
    for (double **each : {&m.by_angle, &m.by_swing, &m.moving_cosine, &m.moving_sine}) arena.take(*each, bodies * 8);
    for (double **each : {&m.by_joint, &m.by_joint_rate}) arena.take(*each, n * 8);
}

static inline void lay_out_motion(Arena &arena, Motion &m, const Robot &robot, Index capsules, Index instants) {
    const Index n = robot.joints;
    lay_out_turn(arena, m, robot, instants);
    for (double **each : {&m.position, &m.p_curvature, &m.acceleration, &m.by_position, &m.by_speed})
        arena.take(*each, n * m.stride);
    for (double **each : {&m.relative, &m.x, &m.y}) arena.take(*each, robot.bodies * m.stride);
    arena.take(m.moment, robot.links * m.stride);
    for (double **each : {&m.base_acceleration, &m.time, &m.attitude, &m.attitude_cosine, &m.attitude_sine, &m.value})
        arena.take(*each, m.stride);
    for (double **each : {&m.end_x, &m.end_y}) arena.take(*each, 2 * capsules * m.stride);
    arena.take(m.weights, (2 + 2 * n + robot.links) * 8);
    arena.take(m.gathered, robot.links * m.stride);
    arena.take(m.by, (3 * n + 1) * 8);
}
