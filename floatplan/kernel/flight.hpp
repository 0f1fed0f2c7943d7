// What an update of a flight's corrections computes, see floatplan/inflight/update.py: the expected state, the filter
// of orientation, momentum and masses, and the rest of the flight written anew and corrected.

class FlightUpdate {
  public:
    FlightUpdate(const Robot &robot, const Constraints &constraints, Flight &flight, double *memory)
        : robot(robot), f(flight), n(robot.joints), g(robot.bodies), m(robot.links), columns(6 + f.width),
          state_size(2 + 2 * m), rest(robot, constraints, flight), correcting(flight, rest, n), arena(aligned(memory)) {
        lay_out_motion(arena, look, robot, 0, 2 * f.law.gap_nodes + 2);
        for (double **each : {&row, &other, &gain}) arena.take(*each, state_size);
        arena.take(values, (columns + 1) * n);
        rest.lay_out(arena);
        correcting.lay_out(arena);
    }

    Index room() const { return arena.numbers(); }

    // Takes in a motion from `begin` to `end`, s; the oldest is forgotten.
    void remember(double begin, double end, const double *coefficients) {
        f.newest = (f.newest + 1) % f.law.memory;
        if (f.known < f.law.memory) ++f.known;
        double *motion = f.motions + f.newest * motion_size();
        motion[0] = begin;
        motion[1] = end;
        multiply(f.table, 3 * columns, columns, coefficients, n, motion + 2);
        double scale = 1;
        for (Index order = 0; order < 3; ++order, scale /= end - begin)
            for (Index e = 0; e < columns * n; ++e) motion[2 + order * columns * n + e] *= scale;
    }

    // Joints and base at the time of a measurement, were they on their reference; how well the orientation is known.
    void expect() {
        const Index nodes = f.law.gap_nodes, here = nodes, measured = 2 * nodes + 1;
        for (Index k = 0; k < nodes; ++k) {
            look_at(k, f.began + (f.measured - f.began) * f.gap[k]);
            look_at(nodes + 1 + k, f.measured + (f.now - f.measured) * f.gap[k]);
        }
        look_at(here, f.measured);
        for (Index i = 0; i < n; ++i) {
            look.position[i * look.stride + measured] = f.measured_positions[i];
            look.speed[i * look.stride + measured] = f.measured_velocities[i];
        }
        turn(robot, look, f.state[1]);
        f.turn_before = turned(0, f.measured - f.began);
        double *inertia = other;
        for (Index b = 0; b < g; ++b) inertia[b] = look.inertia[b * look.stride + here];
        gather(robot, inertia, f.map + 1);
        f.map[0] = inertia[0];
        f.expected_rate = look.rate[here];
        f.aside = 0;
        f.noise = 1;
        for (Index i = 0; i < n; ++i) {
            f.positions[i] = look.position[i * look.stride + here];
            f.velocities[i] = look.speed[i * look.stride + here];
            const double ratio = f.map[1 + i] / f.map[0];
            f.aside -= ratio * (f.measured_positions[i] - f.positions[i]);
            f.noise += ratio * ratio;
        }
        momentum_row(f.expected_rate, here, row);
        const double per_row = (f.measured - f.began) / f.map[0];
        f.variance = f.covariance[0];
        for (Index e = 0; e < state_size; ++e)
            f.variance += per_row * row[e] * (2 * f.covariance[e] + per_row * covaried(e, row));
    }

    // The filter, see floatplan/inflight/estimate.py; right after expect(), whose row it takes.
    void learn() {
        const double dt = f.measured - f.began;
        f.state[0] += f.turn_before;
        momentum_row(f.measured_rate, 2 * f.law.gap_nodes + 1, other);
        double momentum = 0;
        for (Index e = 2; e < state_size; ++e) momentum -= other[e];
        predict(row, dt / f.map[0], dt, gain);
        for (Index e = 0; e < state_size; ++e) other[e] = e == 0;
        const double angle_variance = f.law.angle_noise * f.law.angle_noise * f.noise;
        correct(other, f.measured_orientation - f.aside - f.state[0], angle_variance, gain);
        double innovation = momentum, deviation = 0;
        for (Index e = 0; e < state_size; ++e) {
            innovation -= row[e] * f.state[e];
            deviation += row[e] * covaried(e, row);
        }
        const double variance = f.law.rate_noise * f.law.rate_noise * f.noise * f.map[0] * f.map[0];
        if (believed(innovation, std::sqrt(deviation + variance))) correct(row, innovation, variance, gain);
        for (Index e = 2; e < state_size; ++e)
            f.state[e] = smaller(larger(f.state[e], -f.law.largest_error), f.law.largest_error);
        adapt();
        turn(robot, look, f.state[1]);
        f.turn_after = turned(f.law.gap_nodes + 1, f.now - f.measured);
    }

    // C of the masses found, and of the bodies that turn alike.
    void adapt() {
        const double *masses = f.state + 2, *inertias = masses + m;
        copy(f.link_real, f.nominal_real, m * g);
        copy(f.link_imaginary, f.nominal_imaginary, m * g);
        for (Index e = 0; e < m; ++e) {
            add(masses[e], f.by_mass_real + e * m * g, m * g, f.link_real);
            add(masses[e], f.by_mass_imaginary + e * m * g, m * g, f.link_imaginary);
        }
        zero(f.real, g * g);
        zero(f.imaginary, g * g);
        for (Index b = 0; b < m; ++b) {
            const Index own = robot.group[b];
            f.link_real[b * g + own] += f.inertia[b] * inertias[b];
            add(1, f.link_real + b * g, g, f.real + own * g);
            add(1, f.link_imaginary + b * g, g, f.imaginary + own * g);
        }
    }

    // A motion from a time of its own to its end, written anew from now to the landing.
    void rewrite(const double *motion, double from, double *coefficients) {
        const double left = f.landing - f.now;
        for (Index r = 0; r < columns; ++r) argument(motion, from + f.points[r] * (motion[1] - from), 0, values + r * n);
        multiply(f.of_values, columns, columns, values, n, coefficients);
        double scale = 1;
        for (Index order = 0; order < 3; ++order, scale *= left) {
            argument(motion, from, order, coefficients + order * n);
            for (Index i = 0; i < n; ++i) {
                coefficients[order * n + i] *= scale;
                coefficients[(3 + order) * n + i] = scale * f.at_landing[order * n + i];
            }
        }
    }

    // The present motion.
    void rewrite() { rewrite(motion_at(f.now), f.now, f.coefficients); }

    // Torques of joints and motors in the state that is asked about.
    void find_torques() {
        for (Index i = 0; i < n; ++i) {
            look.position[i * look.stride] = f.asked[i];
            look.speed[i * look.stride] = f.asked[n + i];
            look.acceleration[i * look.stride] = f.asked[2 * n + i];
        }
        turn(robot, look, f.state[1]);
        move_bodies(robot, look);
        const Index torques = n + f.motors;
        for (Index e = 0; e < torques; ++e) f.torques[e] = motor_torque(robot, look, f.turns + e, torques, 0)[0];
    }

    // What comes of the motion whose coefficients are given, or of the present one, corrected.
    void follow(bool corrected) {
        if (corrected) rewrite();
        rest.T = f.landing - f.now;
        rest.h = f.state[1];
        rest.orientation = f.state[0] + f.turn_after;
        rest.change = f.goal - rest.orientation;
        if (!corrected) return correcting.predict(f.coefficients, f.corrected);
        rewrite(f.plan, f.now / f.landing * f.plan[1], f.planned);
        correcting.correct(f.coefficients, f.evaluations, f.corrected);
        remember(f.now, f.landing, f.coefficients);
    }

  private:
    const Robot &robot;
    Flight &f;
    const Index n, g, m, columns, state_size;
    RestOfFlight rest;
    Correcting correcting;
    Arena arena;
    Motion look{};  // between measurements, at the last one, and where that says the joints are
    double *row, *other, *gain, *values;  // (state_size), the last one (columns + 1, n)

    Index motion_size() const { return 2 + 3 * columns * n; }

    const double *motion_at(double time) const {
        for (Index back = 0; back < f.known; ++back) {
            const double *motion = f.motions + ((f.newest + f.law.memory - back) % f.law.memory) * motion_size();
            if (back == f.known - 1 || time >= motion[0]) return motion;
        }
        return f.motions;
    }

    // p (n), or a derivative of it by time; at the nearer end outside of the motion's time.
    void argument(const double *motion, double time, Index order, double *p) const {
        const double u = smaller(larger((time - motion[0]) / (motion[1] - motion[0]), 0), 1);
        chebyshev_sums(motion + 2 + order * columns * n, columns, n, u, 1, p);
    }

    void look_at(Index k, double time) {
        const double *motion = motion_at(time);
        double *p = values, *rate = values + n;
        argument(motion, time, 0, p);
        argument(motion, time, 1, rate);
        const bool outside = time > motion[1] || time < motion[0];
        for (Index i = 0; i < n; ++i) {
            look.position[i * look.stride + k] = f.centre[i] + f.amplitude[i] * std::sin(p[i]);
            look.speed[i * look.stride + k] = outside ? 0 : f.amplitude[i] * std::cos(p[i]) * rate[i];
        }
    }

    // By how much the base turns in `dt` s, from the nodes `from` on.
    double turned(Index from, double dt) const {
        if (dt == 0) return 0;
        return dt * dot(f.gap_weights, look.rate + from, f.law.gap_nodes);
    }

    // How h less the momentum with the plan's masses depends on the state, at instant k and a rate of the base.
    void momentum_row(double rate, Index k, double *row) const {
        row[0] = 0;
        row[1] = 1;
        for (Index e = 0; e < m; ++e) {
            double x = 0, y = 0, moving_x = 0, moving_y = 0;
            for (Index o = 0; o < g; ++o) {
                const Index at = o * look.stride + k;
                double re = f.weights_real[e * g + o], im = f.weights_imaginary[e * g + o];
                double part_x = re * look.body_cosine[at] - im * look.body_sine[at];
                double part_y = re * look.body_sine[at] + im * look.body_cosine[at];
                x += part_x;
                y += part_y;
                moving_x += part_x * (look.swing[at] + rate);
                moving_y += part_y * (look.swing[at] + rate);
            }
            row[2 + e] = -f.mass[e] * (x * moving_x + y * moving_y);
            row[2 + m + e] = -f.inertia[e] * (look.swing[robot.group[e] * look.stride + k] + rate);
        }
    }

    // Of the covariance times a row, an entry.
    double covaried(Index e, const double *row) const { return dot(f.covariance + e * state_size, row, state_size); }

    void predict(const double *row, double per_row, double dt, double *change) {
        double *covariance = f.covariance, again = 0;
        for (Index e = 0; e < state_size; ++e) covariance[e * state_size + e] += dt * f.wander[e];
        for (Index e = 0; e < state_size; ++e) change[e] = per_row * covaried(e, row);
        for (Index e = 0; e < state_size; ++e) {
            covariance[e] += change[e];
            again += row[e] * per_row * change[e];
        }
        for (Index e = 0; e < state_size; ++e) covariance[e * state_size] += change[e];
        covariance[0] += again;
    }

    void correct(const double *row, double innovation, double variance, double *gain) {
        double total = variance;
        for (Index e = 0; e < state_size; ++e) {
            gain[e] = covaried(e, row);
            total += row[e] * gain[e];
        }
        for (Index e = 0; e < state_size; ++e) {
            f.state[e] += gain[e] / total * innovation;
            add(-(gain[e] / total), gain, state_size, f.covariance + e * state_size);
        }
    }

    bool believed(double innovation, double deviation) {
        Index &surprises = *f.surprises;
        if (std::fabs(innovation) <= f.law.surprising * deviation) {
            surprises = 0;
            return true;
        }
        Index side = innovation > 0 ? 1 : -1;
        surprises = surprises * side > 0 ? surprises + side : side;
        if (surprises * side < f.law.most_surprises) return false;
        for (Index known = 0; known < 2; ++known) {
            for (Index e = 0; e < state_size; ++e)
                f.covariance[known * state_size + e] = f.covariance[e * state_size + known] = 0;
            f.covariance[known * state_size + known] = f.deviations[known] * f.deviations[known];
        }
        surprises = 0;
        return true;
    }
};

// How many numbers an update works in.
Index flight_room(const Robot &robot, const Constraints &constraints, Flight &flight) {
    return FlightUpdate(robot, constraints, flight, nullptr).room();
}

void update_flight(const Robot &robot, const Constraints &constraints, Flight &flight, Index what) {
    FlightUpdate update(robot, constraints, flight, flight.room);
    switch (what) {
    case remember_motion: return update.remember(flight.now, flight.landing, flight.coefficients);
    case expect_state: return update.expect();
    case learn_state: return update.learn();
    case adapt_masses: return update.adapt();
    case rewrite_motion: return update.rewrite();
    case find_torques: return update.find_torques();
    case predict_motion: return update.follow(false);
    default: update.follow(true);
    }
}
