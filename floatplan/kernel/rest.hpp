// The rest of a flight under a motion: how the base turns, rows of limits, and their derivatives, at K instants.
//
// Arrays over instants are (..., K); no instant depends on another, as "ivdep" says. Bodies that turn alike are one of g
// groups, E = exp(i turn phi) its rotation; the moments on the m bodies themselves need the rows of C of each, but columns
// of groups alone.

enum LimitKind : std::int64_t {
    velocity_row = 0, acceleration_row = 1, base_rate_row = 2, torque_row = 3, distance_row = 4
};

// Of one motion; what is only needed for torques is there where some row limits one.
struct Ahead {
    double *coefficients;                                          // (6 + width, n)
    double *sine, *cosine, *p_rate, *p_curvature, *speed, *acceleration;  // (n, K), the first two times the amplitude
    double *c, *s, *swing, *inertia, *turned;                      // (g, K): E, phi' less theta0', Re, Im conj(E) C E
    double *relative, *x, *y;                                      // (g, K): phi'' less theta0'', E (phi'' + i turn phi'^2)
    double *moment, *locked_part;                                  // (m, K)
    double *rate, *inverse, *base_acceleration;                    // (K): theta0', 1 / D_0
    double *value, *violation;                                     // (rows, K)
    double *by_position, *by_speed;                                // (n, K): of theta0'
    double *worst;                                                 // (blocks)
    double *angle, *turn_c, *turn_s;                               // (K): theta0 and its rotation, where distances are
    double *end_x, *end_y;                                         // (capsules, 2, K): places
    double miss, square;                                           // square: of all violations
};

class RestOfFlight {
  public:
    RestOfFlight(const Flight &flight) : f(flight), n(f.joints), g(f.groups), m(f.bodies), K(f.instants),
                                         width(f.width), columns(6 + f.width), size(f.joints * f.width) {}

    double T = 0, h = 0, change = 0, orientation = 0;
    bool landed = false;  // distances are those of a base that turns to the goal: the miss is taken off, by time

    void evaluate(Ahead &a) const {
        turn_base(a);
        if (f.torque_rows) move_bodies(a);
        a.miss = -change;
        for (std::int64_t k = 0; k < f.nodes; ++k) a.miss += T * f.weights[k] * a.rate[k];
        if (f.capsules) place_capsules(a);
        look_at_rows(a);
    }

    // Derivatives (n, K) of theta0' by positions and velocities, at some of the instants.
    void differentiate(Ahead &a, std::int64_t first, std::int64_t last) const {
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t k = first; k < last; ++k) a.by_position[i * K + k] = a.by_speed[i * K + k] = 0;
        for (std::int64_t b = 0; b < g; ++b)
            for (std::int64_t k = first; k < last; ++k) {
                double x = 0, y = 0;
                for (std::int64_t o = 0; o < g; ++o) {
                    double re = f.merged_real[b * g + o], im = f.merged_imaginary[b * g + o];
                    double rate = a.swing[o * K + k] + a.rate[k];
                    x += rate * (re * a.c[o * K + k] - im * a.s[o * K + k]);
                    y += rate * (re * a.s[o * K + k] + im * a.c[o * K + k]);
                }
                double moving = a.c[b * K + k] * y - a.s[b * K + k] * x;
                double by_angle = f.turn * (moving + (a.swing[b * K + k] + a.rate[k]) * a.turned[b * K + k]);
                for (std::int64_t i = 0; i < n; ++i) {
                    double turns = f.turns[b * n + i];
                    a.by_position[i * K + k] -= turns * by_angle * a.inverse[k];
                    a.by_speed[i * K + k] -= turns * a.inertia[b * K + k] * a.inverse[k];
                }
            }
    }

    // Derivative (n width) of the miss.
    void miss_by_y(Ahead &a, double *row) const {
        differentiate(a, 0, f.nodes);
        std::memset(row, 0, size * sizeof(double));
        if (f.capsules) {
            std::memset(f.drift, 0, f.nodes * size * sizeof(double));
            for (std::int64_t k = 0; k < f.nodes; ++k) {
                double *drift = f.drift + k * size;
                for (std::int64_t i = 0; i < n; ++i)
                    chain(a, i, k, a.by_position[i * K + k], a.by_speed[i * K + k], 0, drift);
                for (std::int64_t e = 0; e < size; ++e) row[e] += T * f.weights[k] * drift[e];
            }
            return;
        }
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t k = 0; k < f.nodes; ++k) {
                double weight = T * f.weights[k];
                chain(a, i, k, weight * a.by_position[i * K + k], weight * a.by_speed[i * K + k], 0, row);
            }
    }

    // Derivative (n width) of a row at an instant; that of the miss is known.
    void row_by_y(Ahead &a, std::int64_t r, std::int64_t k, double *row) const {
        if (f.row_kind[r] == distance_row) return distance_by_y(a, r, k, row);
        if (k >= f.nodes) differentiate(a, k, k + 1);
        std::memset(row, 0, size * sizeof(double));
        std::int64_t joint = f.row_joint[r];
        double per_limit = -1 / f.row_limit[r];
        switch (f.row_kind[r]) {
        case velocity_row:
            return chain(a, joint, k, 0, per_limit * sign(a.speed[joint * K + k]), 0, row);
        case acceleration_row:
            return chain(a, joint, k, 0, 0, per_limit * sign(a.acceleration[joint * K + k]), row);
        case base_rate_row: {
            double factor = per_limit * sign(a.rate[k]);
            for (std::int64_t i = 0; i < n; ++i)
                chain(a, i, k, factor * a.by_position[i * K + k], factor * a.by_speed[i * K + k], 0, row);
            return;
        }
        default:
            torque_by_y(a, r, k, row);
        }
    }

  private:
    const Flight &f;
    const std::int64_t n, g, m, K, width, columns, size;

    static double sign(double value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }

    void turn_base(Ahead &a) const {
        const double per_second = 1 / T;
        for (std::int64_t i = 0; i < n; ++i) {
            double *p = a.sine + i * K, *rate = a.p_rate + i * K, *curvature = a.p_curvature + i * K;
            for (double *each : {p, rate, curvature}) std::memset(each, 0, K * sizeof(double));
            for (std::int64_t c = 0; c < columns; ++c) {
                const double z = a.coefficients[c * n + i];
                const double *b0 = f.value + c * K, *b1 = f.first + c * K, *b2 = f.second + c * K;
                #pragma GCC ivdep
                for (std::int64_t k = 0; k < K; ++k) {
                    p[k] += z * b0[k];
                    rate[k] += z * b1[k];
                    curvature[k] += z * b2[k];
                }
            }
            for (std::int64_t k = 0; k < K; k += LANES) {
                Vector s, c, amplitude = all(f.amplitude[i]);
                sine_cosine(load(p + k), s, c);
                store(a.sine + i * K + k, amplitude * s);
                store(a.cosine + i * K + k, amplitude * c);
            }
            double *sine = a.sine + i * K, *cosine = a.cosine + i * K;
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) {
                a.speed[i * K + k] = per_second * cosine[k] * rate[k];
                a.acceleration[i * K + k] =
                    per_second * per_second * (cosine[k] * curvature[k] - sine[k] * rate[k] * rate[k]);
            }
        }
        for (std::int64_t b = 0; b < g; ++b) {
            double constant = 0;
            for (std::int64_t i = 0; i < n; ++i) constant += f.turns[b * n + i] * f.centre[i];
            double *angle = a.c + b * K, *swing = a.swing + b * K, *relative = a.relative + b * K;
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) angle[k] = constant, swing[k] = relative[k] = 0;
            for (std::int64_t i = 0; i < n; ++i) {
                const double turns = f.turns[b * n + i];
                if (turns == 0) continue;
                #pragma GCC ivdep
                for (std::int64_t k = 0; k < K; ++k) {
                    angle[k] += turns * a.sine[i * K + k];
                    swing[k] += turns * a.speed[i * K + k];
                    relative[k] += turns * a.acceleration[i * K + k];
                }
            }
            for (std::int64_t k = 0; k < K; k += LANES) {
                Vector s, c;
                sine_cosine(load(angle + k), s, c);
                store(a.s + b * K + k, all(f.turn) * s);
                store(a.c + b * K + k, c);
            }
        }
        #pragma GCC ivdep
        for (std::int64_t k = 0; k < K; ++k) a.inverse[k] = 0, a.rate[k] = h;
        for (std::int64_t b = 0; b < g; ++b) {
            double *inertia = a.inertia + b * K, *turned = a.turned + b * K;
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) inertia[k] = turned[k] = 0;
            for (std::int64_t o = 0; o < g; ++o) {
                const double re = f.merged_real[b * g + o], im = f.merged_imaginary[b * g + o];
                const double *c = a.c + o * K, *s = a.s + o * K, *own_c = a.c + b * K, *own_s = a.s + b * K;
                #pragma GCC ivdep
                for (std::int64_t k = 0; k < K; ++k) {
                    double x = re * c[k] - im * s[k], y = re * s[k] + im * c[k];
                    inertia[k] += own_c[k] * x + own_s[k] * y;
                    turned[k] += own_c[k] * y - own_s[k] * x;
                }
            }
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) {
                a.inverse[k] += inertia[k];
                a.rate[k] -= inertia[k] * a.swing[b * K + k];
            }
        }
        #pragma GCC ivdep
        for (std::int64_t k = 0; k < K; ++k) {
            a.inverse[k] = 1 / a.inverse[k];
            a.rate[k] *= a.inverse[k];
        }
    }

    // Moments that turn the bodies, and what they would be for a base acceleration of 1.
    void move_bodies(Ahead &a) const {
        for (std::int64_t b = 0; b < g; ++b)
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) {
                double c = a.c[b * K + k], s = a.s[b * K + k], relative = a.relative[b * K + k];
                double rate = a.swing[b * K + k] + a.rate[k], centripetal = f.turn * rate * rate;
                a.x[b * K + k] = c * relative - s * centripetal;
                a.y[b * K + k] = s * relative + c * centripetal;
            }
        #pragma GCC ivdep
        for (std::int64_t k = 0; k < K; ++k) a.base_acceleration[k] = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            const std::int64_t own = f.group[b];
            double *moment = a.moment + b * K, *locked = a.locked_part + b * K;
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) {
                moment[k] = f.inertia[b] * a.relative[own * K + k];
                locked[k] = f.inertia[b];
            }
            for (std::int64_t o = 0; o < g; ++o) {
                const double re = f.rows_real[b * g + o], im = f.rows_imaginary[b * g + o];
                const double *c = a.c + own * K, *s = a.s + own * K;
                const double *x = a.x + o * K, *y = a.y + o * K, *oc = a.c + o * K, *os = a.s + o * K;
                #pragma GCC ivdep
                for (std::int64_t k = 0; k < K; ++k) {
                    moment[k] += c[k] * (re * x[k] - im * y[k]) + s[k] * (re * y[k] + im * x[k]);
                    locked[k] += c[k] * (re * oc[k] - im * os[k]) + s[k] * (re * os[k] + im * oc[k]);
                }
            }
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k) a.base_acceleration[k] -= moment[k] * a.inverse[k];
        }
        for (std::int64_t b = 0; b < m; ++b)
            #pragma GCC ivdep
            for (std::int64_t k = 0; k < K; ++k)
                a.moment[b * K + k] += a.base_acceleration[k] * a.locked_part[b * K + k];
    }

    double torque(const Ahead &a, std::int64_t r, std::int64_t k) const {
        double total = 0;
        for (std::int64_t b = 0; b < m; ++b) total += f.row_turns[r * m + b] * a.moment[b * K + k];
        return total;
    }

    double motor_speed(const Ahead &a, std::int64_t r, std::int64_t k) const {
        double total = 0;
        for (std::int64_t i = 0; i < n; ++i) total += f.row_ratios[r * n + i] * a.speed[i * K + k];
        return total;
    }

    // What a row limits (K): a rate, an acceleration, or a torque with what its motor's speed takes.
    void use(const Ahead &a, std::int64_t r, double *used) const {
        const double *of = f.row_kind[r] == velocity_row       ? a.speed + f.row_joint[r] * K
                           : f.row_kind[r] == acceleration_row ? a.acceleration + f.row_joint[r] * K
                                                               : a.rate;
        if (f.row_kind[r] != torque_row) {
            for (std::int64_t k = 0; k < K; ++k) used[k] = std::fabs(of[k]);
            return;
        }
        for (std::int64_t k = 0; k < K; ++k) used[k] = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            const double turns = f.row_turns[r * m + b], *moment = a.moment + b * K;
            if (turns == 0) continue;
            for (std::int64_t k = 0; k < K; ++k) used[k] += turns * moment[k];
        }
        for (std::int64_t k = 0; k < K; ++k) used[k] = std::fabs(used[k]);
        if (f.row_slope[r] == 0) return;
        for (std::int64_t k = 0; k < K; ++k) used[k] += f.row_slope[r] * std::fabs(motor_speed(a, r, k));
    }

    // The ends of the capsules at the watched instants.
    void place_capsules(Ahead &a) const {
        const std::int64_t first = f.nodes;
        for (std::int64_t k = first; k < K; ++k) {
            const double *integral = f.integrals + (k - first) * f.nodes;
            double turned = 0;
            for (std::int64_t j = 0; j < f.nodes; ++j) turned += integral[j] * a.rate[j];
            a.angle[k] = orientation + T * turned - landed * a.miss * f.s[k];
        }
        sines_cosines(K - first, a.angle + first, a.turn_s + first, a.turn_c + first);
        for (std::int64_t k = first; k < K; ++k) a.turn_s[k] *= f.turn;
        for (std::int64_t e = 0; e < 2 * f.capsules; ++e) {
            double *x = a.end_x + e * K, *y = a.end_y + e * K;
            #pragma GCC ivdep
            for (std::int64_t k = first; k < K; ++k) x[k] = y[k] = 0;
            for (std::int64_t b = 0; b < g; ++b) {
                const double re = f.ends_real[e * g + b], im = f.ends_imaginary[e * g + b];
                const double *c = a.c + b * K, *s = a.s + b * K;
                if (re == 0 && im == 0) continue;
                #pragma GCC ivdep
                for (std::int64_t k = first; k < K; ++k) {
                    x[k] += re * c[k] - im * s[k];
                    y[k] += re * s[k] + im * c[k];
                }
            }
            #pragma GCC ivdep
            for (std::int64_t k = first; k < K; ++k) {
                const double dt = T * f.s[k], along = x[k], up = y[k];
                x[k] = f.path[0] + f.path[2] * dt + a.turn_c[k] * along - a.turn_s[k] * up;
                y[k] = f.path[1] + f.path[3] * dt - f.path[4] * dt * dt / 2 + a.turn_s[k] * along + a.turn_c[k] * up;
            }
        }
    }

    Nearest nearest(const Ahead &a, std::int64_t r, std::int64_t k) const {
        auto end = [&](std::int64_t e) { return Place{a.end_x[e * K + k], a.end_y[e * K + k]}; };
        const std::int64_t own = f.row_joint[r], other = f.row_other[r];
        Nearest found;
        if (f.row_shape[r] == pair_row) {
            found = between(end(2 * own), end(2 * own + 1), end(2 * other), end(2 * other + 1));
            found.distance -= f.radius[own] + f.radius[other];
        } else {
            const double *obstacle = f.obstacles + 7 * other;
            found = to_obstacle(f.row_shape[r], obstacle, f.now + T * f.s[k], end(2 * own), end(2 * own + 1));
            found.distance -= f.radius[own] + obstacle[6];
        }
        return found;
    }

    // Values (K) of a row of distances; infinite at the nodes, and outside of its window.
    void distances(const Ahead &a, std::int64_t r, double *value) const {
        for (std::int64_t k = 0; k < K; ++k) {
            const double time = f.now + T * f.s[k];
            const bool there = k >= f.nodes && time >= f.row_window[2 * r] && time <= f.row_window[2 * r + 1];
            value[k] = there ? (nearest(a, r, k).distance - f.row_limit[r]) / f.length_scale : HUGE_VAL;
        }
    }

    void distance_by_y(const Ahead &a, std::int64_t r, std::int64_t k, double *row) const {
        const Nearest found = nearest(a, r, k);
        double *by_angle = f.scratch, by_attitude = 0;  // (g)
        for (std::int64_t b = 0; b < g; ++b) {
            by_angle[b] = along(a, found.direction, f.row_joint[r], found.own, b, k);
            if (f.row_shape[r] == pair_row) by_angle[b] -= along(a, found.direction, f.row_other[r], found.other, b, k);
            by_angle[b] /= f.length_scale;
            by_attitude += by_angle[b];
        }
        std::memset(row, 0, size * sizeof(double));
        for (std::int64_t i = 0; i < n; ++i) {
            double by_position = 0;
            for (std::int64_t b = 0; b < g; ++b) by_position += f.turns[b * n + i] * by_angle[b];
            chain(a, i, k, by_position, 0, 0, row);
        }
        for (std::int64_t j = 0; j < f.nodes; ++j) {
            const double integral = f.integrals[(k - f.nodes) * f.nodes + j] - landed * f.s[k] * f.weights[j];
            const double weight = by_attitude * T * integral, *drift = f.drift + j * size;
            for (std::int64_t e = 0; e < size; ++e) row[e] += weight * drift[e];
        }
    }

    // How fast a point of a capsule, a share along it, moves in a direction as a group of bodies turns, m/rad.
    double along(const Ahead &a, Place direction, std::int64_t capsule, double share, std::int64_t b, std::int64_t k) const {
        const std::int64_t start = 2 * capsule * g + b, end = start + g;
        const double re = (1 - share) * f.ends_real[start] + share * f.ends_real[end];
        const double im = (1 - share) * f.ends_imaginary[start] + share * f.ends_imaginary[end];
        const double c = a.c[b * K + k], s = a.s[b * K + k], x = re * c - im * s, y = re * s + im * c;
        const double turned_x = a.turn_c[k] * x - a.turn_s[k] * y, turned_y = a.turn_s[k] * x + a.turn_c[k] * y;
        return f.turn * (direction.y * turned_x - direction.x * turned_y);
    }

    void look_at_rows(Ahead &a) const {
        a.square = 0;
        for (std::int64_t block = 0; block < f.blocks; ++block) {
            a.worst[block] = HUGE_VAL;
            for (std::int64_t r = f.block_first[block]; r < f.block_first[block + 1]; ++r) {
                double *value = a.value + r * K, *violation = a.violation + r * K;
                if (f.row_kind[r] == distance_row) {
                    distances(a, r, value);
                } else {
                    use(a, r, value);
                    for (std::int64_t k = 0; k < K; ++k) value[k] = 1 - value[k] / f.row_limit[r];
                }
                for (std::int64_t k = 0; k < K; ++k) {
                    violation[k] = 0;
                    if (value[k] < a.worst[block] || std::isnan(value[k])) a.worst[block] = value[k];
                    if (value[k] >= f.aim[block]) continue;
                    violation[k] = (f.aim[block] - value[k]) / f.softness[block];
                    a.square += violation[k] * violation[k];
                }
            }
        }
    }

    // Adds what derivatives by position, velocity and acceleration of a joint at an instant are by y.
    void chain(const Ahead &a, std::int64_t i, std::int64_t k, double by_position, double by_speed,
               double by_acceleration, double *row) const {
        const double per_second = 1 / T, sine = a.sine[i * K + k], cosine = a.cosine[i * K + k];
        const double rate = a.p_rate[i * K + k], speed_by_p = -per_second * sine * rate;
        double by_value = by_position * cosine + by_speed * speed_by_p;
        by_value -= by_acceleration * per_second * per_second * (sine * a.p_curvature[i * K + k] + cosine * rate * rate);
        double by_rate = by_speed * per_second * cosine + by_acceleration * 2 * per_second * speed_by_p;
        double by_curvature = by_acceleration * per_second * per_second * cosine;
        const double scale = 1 / f.amplitude[i];
        const double *f0 = f.free_value + k * width, *f1 = f.free_first + k * width, *f2 = f.free_second + k * width;
        for (std::int64_t c = 0; c < width; ++c)
            row[i * width + c] += scale * (by_value * f0[c] + by_rate * f1[c] + by_curvature * f2[c]);
    }

    // As moment_derivatives() of motion/planar/closed_form.py, backwards: what the base's acceleration does to a sum is taken
    // off its weights.
    void torque_by_y(const Ahead &a, std::int64_t r, std::int64_t k, double *row) const {
        const double per_limit = -1 / f.row_limit[r], factor = per_limit * sign(torque(a, r, k));
        const double drag = per_limit * f.row_slope[r] * sign(motor_speed(a, r, k));
        double *weight = f.scratch, *gathered = weight + m;  // (m), (m)
        double along = 0;
        for (std::int64_t b = 0; b < m; ++b) {
            weight[b] = factor * f.row_turns[r * m + b];
            along += weight[b] * a.locked_part[b * K + k];
        }
        for (std::int64_t b = 0; b < m; ++b) weight[b] -= along * a.inverse[k];
        for (std::int64_t b = 0; b < m; ++b) {
            const std::int64_t own = f.group[b];
            double x = 0, y = 0;
            for (std::int64_t o = 0; o < g; ++o) {
                double re = f.rows_real[b * g + o], im = f.rows_imaginary[b * g + o];
                double px = a.x[o * K + k] + a.base_acceleration[k] * a.c[o * K + k];
                double py = a.y[o * K + k] + a.base_acceleration[k] * a.s[o * K + k];
                x += re * px - im * py;
                y += re * py + im * px;
            }
            gathered[b] = a.c[own * K + k] * y - a.s[own * K + k] * x;
        }
        double by_base_rate = 0;
        double *by_angle = gathered + m, *by_rate = by_angle + g, *by_acceleration = by_rate + g;  // (g) each
        for (std::int64_t o = 0; o < g; ++o) {
            double x = 0, y = 0;  // sum_b w_b conj(E_b) C_bo
            by_angle[o] = by_acceleration[o] = 0;
            for (std::int64_t b = 0; b < m; ++b) {
                const std::int64_t own = f.group[b];
                double re = f.rows_real[b * g + o], im = f.rows_imaginary[b * g + o];
                double c = weight[b] * a.c[own * K + k], s = -weight[b] * a.s[own * K + k];
                x += c * re - s * im;
                y += c * im + s * re;
                if (own != o) continue;
                by_angle[o] += f.turn * weight[b] * gathered[b];
                by_acceleration[o] += weight[b] * f.inertia[b];
            }
            double real = x * a.c[o * K + k] - y * a.s[o * K + k], imaginary = x * a.s[o * K + k] + y * a.c[o * K + k];
            double rate = a.swing[o * K + k] + a.rate[k];
            by_rate[o] = -2 * f.turn * imaginary * rate;
            by_angle[o] -= real * rate * rate;
            by_angle[o] -= f.turn * imaginary * (a.relative[o * K + k] + a.base_acceleration[k]);
            by_acceleration[o] += real;
            by_base_rate += by_rate[o];
        }
        for (std::int64_t i = 0; i < n; ++i) {
            double position = by_base_rate * a.by_position[i * K + k];
            double speed = by_base_rate * a.by_speed[i * K + k] + drag * f.row_ratios[r * n + i], acceleration = 0;
            for (std::int64_t o = 0; o < g; ++o) {
                double turns = f.turns[o * n + i];
                position += turns * by_angle[o];
                speed += turns * by_rate[o];
                acceleration += turns * by_acceleration[o];
            }
            chain(a, i, k, position, speed, acceleration, row);
        }
    }
};
