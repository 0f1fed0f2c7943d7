// What an update of a flight's corrections computes, see floatplan/inflight/update.py: the expected state, the filter
// of orientation, momentum and masses, and the remaining flight written anew and corrected.
//
// What is measured of a flight in a plane and in space is a Filter, of remaining_in_plane.hpp or remaining_in_space.hpp. Its
// state is that of `equalities` numbers each of orientation and momentum, then of masses and inertias. In space the attitude
// R is CorrectedFlight::attitude, and the first three numbers are a small turn dR = [zeta]x R, which it takes on after each
// measurement.
//
//     Body, Remaining, equalities, joints, masses
//     motion               its joints, at the instants between measurements
//     move                 what the next need of the joints there
//     turn_before, turn_after  how the base turns until the measurement, and from there until now
//     expect               the state at the measurement, as far as it follows
//     momentum_rows        how h less the momentum with the plan's masses depends on the state, at rates of the base
//     turns_by_momentum    how the base turns in some time with that; momentum_variance: of h that is measured
//     go_on, off, take_correction  the orientation until the measurement; by what it is off; that is taken over
//     adapt                the robot is one of the masses found
//     find_moments         torques of a state

template <typename Filter> class FlightUpdate {
  public:
    static constexpr Index e = Filter::equalities;

    FlightUpdate(const typename Filter::Body &robot, const Constraints &constraints, CorrectedFlight &flight, double *memory)
        : f(flight), filter(robot, flight), n(filter.joints), columns(6 + f.width), state_size(2 * e + 2 * filter.masses),
          rest(robot, constraints, flight), correcting(flight, rest, n), arena(aligned(memory)) {
        filter.lay_out(arena, 2 * f.options.gap_nodes + 2);
        for (double **each : {&row, &other, &gain}) arena.take(*each, e * state_size);
        arena.take(values, (columns + 1) * n);
        rest.lay_out(arena);
        correcting.lay_out(arena);
    }

    Index room() const { return arena.numbers(); }

    // Takes in a motion from `begin` to `end`, s; the oldest is forgotten.
    void remember(double begin, double end, const double *coefficients) {
        f.newest = (f.newest + 1) % f.options.memory;
        if (f.known < f.options.memory) ++f.known;
        double *motion = f.motions + f.newest * motion_size();
        motion[0] = begin;
        motion[1] = end;
        multiply(f.table, 3 * columns, columns, coefficients, n, motion + 2);
        double scale = 1;
        for (Index order = 0; order < 3; ++order, scale /= end - begin)
            for (Index e = 0; e < columns * n; ++e) motion[2 + order * columns * n + e] *= scale;
    }

    // Joints and base at the time of a measurement, were they on their reference; how far the measured ones are from there.
    void expect() {
        const Index nodes = f.options.gap_nodes, here = nodes, measured = 2 * nodes + 1;
        Motion &look = filter.motion();
        for (Index k = 0; k < nodes; ++k) {
            look_at(k, f.began + (f.measured - f.began) * f.gap[k]);
            look_at(nodes + 1 + k, f.measured + (f.now - f.measured) * f.gap[k]);
        }
        look_at(here, f.measured);
        for (Index i = 0; i < n; ++i) {
            look.position[i * look.stride + measured] = f.measured_positions[i];
            look.speed[i * look.stride + measured] = f.measured_velocities[i];
        }
        filter.move();
        filter.turn_before(f.measured - f.began);
        for (Index i = 0; i < n; ++i) {
            f.positions[i] = look.position[i * look.stride + here];
            f.joints_off[i] = std::fabs(f.measured_positions[i] - f.positions[i]);
            f.joints_off[n + i] = std::fabs(f.measured_velocities[i] - look.speed[i * look.stride + here]);
        }
        filter.expect(here);
        filter.momentum_rows(f.expected_rate, here, row);
        find_growth(f.measured - f.began);
        for (Index a = 0; a < e; ++a) {
            double variance = f.covariance[a * state_size + a];
            for (Index s = 0; s < state_size; ++s)
                variance += grown(a, s) * (2 * f.covariance[a * state_size + s] + gain[a * state_size + s]);
            const double of_angles = f.options.outlier_noise * f.options.outlier_noise * f.noise[a];
            f.allowed[a] = f.options.believable * std::sqrt(larger(0, variance) + of_angles);
            f.rate_off[a] = std::fabs(f.measured_rate[a] - f.expected_rate[a]);
        }
    }

    // The filter, see floatplan/inflight/estimate.py; right after expect(), whose rows it takes.
    void learn() {
        const double dt = f.measured - f.began;
        double momentum[e];
        filter.momentum_rows(f.measured_rate, 2 * f.options.gap_nodes + 1, other);
        for (Index a = 0; a < e; ++a) {
            momentum[a] = 0;
            for (Index s = 2 * e; s < state_size; ++s) momentum[a] -= other[a * state_size + s];
        }
        filter.go_on();
        predict(dt);
        for (Index a = 0; a < e; ++a) {
            for (Index s = 0; s < state_size; ++s) other[s] = s == a;
            correct(other, filter.off(a), f.options.angle_noise * f.options.angle_noise * f.noise[a]);
        }
        for (Index a = 0; a < e; ++a) {
            const double *own = row + a * state_size;
            double innovation = momentum[a], deviation = 0;
            for (Index s = 0; s < state_size; ++s) {
                innovation -= own[s] * f.state[s];
                deviation += own[s] * covaried(s, own);
            }
            const double variance = filter.momentum_variance(a);
            if (believed(a, innovation, std::sqrt(deviation + variance))) correct(own, innovation, variance);
        }
        for (Index s = 2 * e; s < state_size; ++s)
            f.state[s] = smaller(larger(f.state[s], -f.options.largest_error), f.options.largest_error);
        filter.take_correction();
        filter.adapt();
        filter.turn_after(f.options.gap_nodes + 1, f.now - f.measured);
    }

    void adapt() { filter.adapt(); }

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

    // Torques of joints and motors in a state of the joints.
    void find_torques() {
        Motion &look = filter.motion();
        for (Index i = 0; i < n; ++i) {
            look.position[i * look.stride] = f.asked[i];
            look.speed[i * look.stride] = f.asked[n + i];
            look.acceleration[i * look.stride] = f.asked[2 * n + i];
        }
        filter.find_moments();
        const Index torques = n + f.motors, links = rest.links();
        for (Index s = 0; s < torques; ++s) f.torques[s] = motor_torque(links, look, f.turns + s, torques, 0)[0];
    }

    // What comes of the motion whose coefficients are given, or of the present one, corrected.
    void follow(bool corrected) {
        if (corrected) rewrite();
        rest.begin();
        if (!corrected) return correcting.predict(f.coefficients, f.corrected);
        rewrite(f.plan, f.now / f.landing * f.plan[1], f.planned);
        correcting.correct(f.coefficients, f.evaluations, f.corrected);
        remember(f.now, f.landing, f.coefficients);
    }

  private:
    using Remaining = typename Filter::Remaining;

    CorrectedFlight &f;
    Filter filter;  // between measurements, at the last one, and where that says the joints are
    const Index n, columns, state_size;
    RestOfFlight<Remaining> rest;
    Correcting<Remaining> correcting;
    Arena arena;
    double *row, *other, *gain, *values;  // (e, state_size), the last one (columns + 1, n)
    double growth[e * e];                 // turns that a surplus of momentum makes until the measurement

    Index motion_size() const { return 2 + 3 * columns * n; }

    const double *motion_at(double time) const {
        for (Index back = 0; back < f.known; ++back) {
            const double *motion = f.motions + ((f.newest + f.options.memory - back) % f.options.memory) * motion_size();
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
        Motion &look = filter.motion();
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

    // Of the covariance times a row, an entry.
    double covaried(Index s, const double *row) const { return dot(f.covariance + s * state_size, row, state_size); }

    // By how much a state makes the base turn until the measurement, about an axis.
    double grown(Index axis, Index s) const {
        double by = growth[axis * e] * row[s];
        for (Index b = 1; b < e; ++b) by += growth[axis * e + b] * row[b * state_size + s];
        return by;
    }

    // That, and in `gain` its covariance with the state.
    void find_growth(double dt) {
        filter.turns_by_momentum(dt, growth);
        for (Index s = 0; s < state_size; ++s) {
            double covariances[e];
            for (Index b = 0; b < e; ++b) covariances[b] = covaried(s, row + b * state_size);
            for (Index a = 0; a < e; ++a) {
                double &by = gain[a * state_size + s] = growth[a * e] * covariances[0];
                for (Index b = 1; b < e; ++b) by += growth[a * e + b] * covariances[b];
            }
        }
    }

    void predict(double dt) {
        double *covariance = f.covariance, again[e * e] = {};
        for (Index s = 0; s < state_size; ++s) covariance[s * state_size + s] += dt * f.wander[s];
        find_growth(dt);
        for (Index a = 0; a < e; ++a)
            for (Index s = 0; s < state_size; ++s) {
                covariance[a * state_size + s] += gain[a * state_size + s];
                for (Index b = 0; b < e; ++b) again[a * e + b] += grown(a, s) * gain[b * state_size + s];
            }
        for (Index a = 0; a < e; ++a) {
            for (Index s = 0; s < state_size; ++s) covariance[s * state_size + a] += gain[a * state_size + s];
            for (Index b = 0; b < e; ++b) covariance[a * state_size + b] += again[a * e + b];
        }
    }

    void correct(const double *row, double innovation, double variance) {
        double total = variance;
        for (Index s = 0; s < state_size; ++s) {
            gain[s] = covaried(s, row);
            total += row[s] * gain[s];
        }
        for (Index s = 0; s < state_size; ++s) {
            f.state[s] += gain[s] / total * innovation;
            add(-(gain[s] / total), gain, state_size, f.covariance + s * state_size);
        }
    }

    bool believed(Index axis, double innovation, double deviation) {
        Index &surprises = f.surprises[axis];
        if (std::fabs(innovation) <= f.options.surprising * deviation) {
            surprises = 0;
            return true;
        }
        Index side = innovation > 0 ? 1 : -1;
        surprises = surprises * side > 0 ? surprises + side : side;
        if (surprises * side < f.options.most_surprises) return false;
        for (Index known = 0; known < 2 * e; ++known) {
            for (Index s = 0; s < state_size; ++s)
                f.covariance[known * state_size + s] = f.covariance[s * state_size + known] = 0;
            f.covariance[known * state_size + known] = f.deviations[known] * f.deviations[known];
        }
        surprises = 0;
        return true;
    }
};

// How many numbers an update works in.
template <typename Filter>
Index room_of_update(const typename Filter::Body &robot, const Constraints &constraints, CorrectedFlight &flight) {
    return FlightUpdate<Filter>(robot, constraints, flight, nullptr).room();
}

template <typename Filter>
static void update(const typename Filter::Body &robot, const Constraints &constraints, CorrectedFlight &flight, Index what) {
    FlightUpdate<Filter> update(robot, constraints, flight, flight.room);
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

Index flight_room(const Robot &robot, const Constraints &constraints, CorrectedFlight &flight) {
    return room_of_update<PlanarFilter>(robot, constraints, flight);
}
Index flight_room_in_space(const SpatialBody &robot, const Constraints &constraints, CorrectedFlight &flight) {
    return room_of_update<SpatialFilter>(robot, constraints, flight);
}

void update_flight(const Robot &robot, const Constraints &constraints, CorrectedFlight &flight, Index what) {
    update<PlanarFilter>(robot, constraints, flight, what);
}
void update_flight_in_space(const SpatialBody &robot, const Constraints &constraints, CorrectedFlight &flight, Index what) {
    update<SpatialFilter>(robot, constraints, flight, what);
}
