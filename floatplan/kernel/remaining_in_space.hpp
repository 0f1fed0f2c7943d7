// The remaining flight in space, see prediction.hpp; and what is measured of one, see flight.hpp.
//
// The remaining flight is a SpatialFlightEvaluator that begins now, with the attitude, the momentum and the masses that are
// estimated.

// What flies, with these masses.
static inline SpatialBody adapted_body(const SpatialBody &robot, const CorrectedFlight &f) {
    SpatialBody body = robot;
    body.tree.mass = f.body_mass;
    body.tree.first = f.body_first;
    body.tree.second = f.body_second;
    body.momentum = f.state + 3;
    body.axes = nullptr;
    return body;
}

class SpatialRemaining {
  public:
    using Body = SpatialBody;
    using Point = Threes;
    using State = SpatialFlightEvaluator::State;
    static constexpr Index equalities = 3;

    bool landed = false;  // see RestOfFlight::land()

    SpatialRemaining(const SpatialBody &robot, const Constraints &constraints, const CorrectedFlight &flight)
        : body(adapted_body(robot, flight)), flies{body, &flight.cells, robot.joints}, constraints(constraints), f(flight),
          flight(flies, constraints, motions, &nodes, settings) {
        body.start = attitude;
    }

    static Motion &motion_of(State &state) { return state.at.motion; }
    static const Motion &motion_of(const State &state) { return state.at.motion; }
    Terms terms() const { return {body.joints, body.tree.joints}; }
    Index first_placed() const { return 0; }

    void lay_out(Arena &arena, State &state) const {
        Motion shared;
        flight.lay_out(arena, shared, state, f.instants);
    }

    void lay_out(Arena &arena) {
        flight.lay_out(arena, f.nodes, f.instants);
        arena.take(as_it_turns, 9 * f.instants);
    }

    void begin(double seconds) {
        motions.duration = seconds;
        store(attitude, matrix3(f.turn_after) * matrix3(f.attitude));
        flight.look_at(0, f.s, f.instants, true);
    }

    void turn_base(State &state, double *miss) {
        copy(state.h_W, f.state + 3, 3);
        for (Index k = 0; k < f.instants; ++k) state.at.motion.time[k] = f.now + motions.duration * f.s[k];
        flight.turn_base(state.at.motion, state, miss);
    }

    void move_links(State &state, const double *miss) {
        if (!state.turned.is_known) return;
        flight.move_links(state.at.motion, state, true, false);
        if (landed) place_as_landed(state, miss);
    }

    void find_moments(State &state) {
        if (constraints.needs_moments || !state.turned.is_known) return;
        body.needs_rates = 1;
        flight.move_links(state.at.motion, state, true, false);
        body.needs_rates = needs_rates;
        move_tree(flies, state.at, true);
        for (Index k = 0; k < f.instants; k += LANES) drive_tree(flies, state.at, k);
    }

    void differentiate_miss(State &state, const Variables &variables, double *rows) {
        flight.differentiate(state.at.motion, state, variables, rows);
    }

    // Of a base that turns to the goal as of the one that does not: steps are judged by the rows' values.
    void differentiate(State &state, const Variables &variables, Index row, Index k, double *pack) {
        flight.row_slopes(state.at.motion, state, variables, row, k / 8 * 8, pack);
    }

  private:
    SpatialBody body;
    const InSpace flies;
    const Constraints &constraints;
    const CorrectedFlight &f;
    const Index needs_rates = body.needs_rates;
    const Settings settings{};
    double attitude[9];  // now
    Motions motions = motions_of(f, body.joints);
    const Nodes nodes = nodes_of(f);
    SpatialFlightEvaluator flight;

    static Motions motions_of(const CorrectedFlight &f, Index joints) {
        Motions motions{};
        motions.size = joints * f.width;
        motions.first = f.columns;
        return motions;
    }

    static Nodes nodes_of(const CorrectedFlight &f) {
        Nodes nodes{};
        nodes.nodes = f.nodes;
        return nodes;
    }

    // Places of the capsules where the base turns to the goal: what it misses is taken off, by time.
    void place_as_landed(State &state, const double *miss) {
        SpatialAt &at = state.at;
        const Vector3 missed_W = matrix3(body.goal) * vector3(miss);
        copy(as_it_turns, at.attitude, 9 * at.stride);
        for (Index k = 0; k < f.instants; ++k) {
            double turned[9];
            for (Index e = 0; e < 9; ++e) turned[e] = at.attitude[e * at.stride + k];
            store(turned, exponential(-f.s[k] * missed_W) * matrix3(turned));
            for (Index e = 0; e < 9; ++e) at.attitude[e * at.stride + k] = turned[e];
        }
        for (Index k = 0; k < f.instants; k += LANES) {
            move_bodies(body.tree, TreeJoints{at, k, nothing(), false}, at.bodies);
            place_capsules(constraints, at, k);
        }
        copy(at.attitude, as_it_turns, 9 * at.stride);
    }

    double *as_it_turns = nullptr;  // (9, K): attitudes
};

class SpatialFilter {
  public:
    using Body = SpatialBody;
    using Remaining = SpatialRemaining;
    static constexpr Index equalities = 3;

    const Index joints, masses;

    SpatialFilter(const SpatialBody &robot, CorrectedFlight &flight)
        : joints(robot.joints), masses(robot.tree.joints + 1), nominal(robot.tree), body(adapted_body(robot, flight)),
          flies{body, &flight.gap_cells, robot.joints}, f(flight) {}

    void lay_out(Arena &arena, Index instants) {
        lay_out_in_space(arena, look, flies, 0, instants);
        const Index stride = (instants + 7) / 8 * 8;
        turned.lay_out(arena, stride);
        arena.take(inertia, 9 * stride);
        arena.take(relative, 3 * stride);
        arena.take(joint_map, 3 * joints);
        for (double **each : {&per_momentum, &of_base}) arena.take(*each, 9);
        room.lay_out(arena, Turned::MOST_STAGES, 3);
    }

    Motion &motion() { return look.motion; }
    const Motion &motion() const { return look.motion; }

    // I and A q' at all instants.
    void move() {
        move_tree(flies, look, false);
        for (Index k = 0; k < look.stride; k += LANES) {
            move_bodies(body.tree, TreeJoints{look, k, nothing(), false}, look.bodies);
            const MomentumMaps maps(look.bodies);
            const Nines of_base = maps.inertia();
            const Threes of_joints = maps.momentum();
            for (Index lane = 0; lane < LANES; ++lane) {
                store(inertia + 9 * (k + lane), lane_of(of_base, lane));
                store(relative + 3 * (k + lane), lane_of(of_joints, lane));
            }
        }
    }

    void turn_before(double dt) { turn_for(0, dt, f.turn_before); }
    void turn_after(Index from, double dt) {
        move();
        turn_for(from, dt, f.turn_after);
    }

    // The rates of the base at an instant, in its axes, and what differences of the joints from there make of the attitude.
    void expect(Index here) {
        const Matrix3 attitude = matrix3(f.turn_before) * matrix3(f.attitude);
        const Matrix3 per_inertia = inverse(matrix3(inertia + 9 * here));
        store(f.expected_rate, per_inertia * (vector3(f.state + 3) * attitude - vector3(relative + 3 * here)));
        store(per_momentum, attitude * per_inertia * transposed(attitude));
        store(of_base, attitude * matrix3(inertia + 9 * here) * transposed(attitude));
        find_joint_map(here);
        double aside[3] = {0, 0, 0};
        for (Index a = 0; a < 3; ++a) f.noise[a] = 1;
        for (Index i = 0; i < joints; ++i) {
            double ratio[3];
            store(ratio, attitude * (per_inertia * vector3(joint_map + 3 * i)));
            for (Index a = 0; a < 3; ++a) {
                aside[a] -= ratio[a] * (f.measured_positions[i] - f.positions[i]);
                f.noise[a] += ratio[a] * ratio[a];
            }
        }
        copy(f.aside, aside, 3);
    }

    void turns_by_momentum(double dt, double *per_row) const { store(per_row, dt * matrix3(per_momentum)); }

    // Of an axis of the world: that of all rates.
    double momentum_variance(Index axis) const {
        double variance = 0;
        for (Index a = 0; a < 3; ++a) variance += of_base[3 * axis + a] * of_base[3 * axis + a] * f.noise[a];
        return f.options.rate_noise * f.options.rate_noise * variance;
    }

    // In the world: with the attitude that is expected, which a small turn changes by [h]x.
    void momentum_rows(const double *rates, Index k, double *rows) {
        const Index first = k / LANES * LANES, lane = k % LANES, size = 6 + 2 * masses;
        const Matrix3 attitude = matrix3(f.turn_before) * matrix3(f.attitude), turned = cross_matrix(vector3(f.state + 3));
        const Threes w_B = everywhere<Threes>(rates);
        move_bodies(nominal, TreeJoints{look, first, w_B, false}, look.bodies);
        const Carried &whole = look.bodies.carried[0];
        const Vector per_mass = all(1) / whole.mass;
        const Threes center = per_mass * whole.first, moving = per_mass * whole.momentum;
        zero(rows, 3 * size);
        for (Index a = 0; a < 3; ++a) {
            store(rows + a * size, turned.row[a]);
            rows[a * size + 3 + a] = 1;
        }
        for (Index link = 0; link < masses; ++link) {
            const double mass = nominal.mass[link];
            if (!(mass > 0)) continue;
            const Nines own = look.bodies.turned[link];
            const Moving v = look.bodies.velocity[link];
            const Vector3 own_center = (1 / mass) * vector3(nominal.first + 3 * link);
            double of_center[3];
            store(of_center, own_center);
            const Threes place = look.bodies.place[link] + own * triple<Vector>(of_center);
            const Threes speed = v.linear + cross(v.angular, place);
            const Threes by_mass = all(mass) * cross(place - center, speed - moving);
            double about_center[9];
            store(about_center, own_inertia(link));
            const Threes by_inertia = own * (square<Vector>(about_center) * (v.angular * own));
            double entries[3], others[3];
            store(entries, attitude * lane_of(by_mass, lane));
            store(others, attitude * lane_of(by_inertia, lane));
            for (Index a = 0; a < 3; ++a) {
                rows[a * size + 6 + link] = -entries[a];
                rows[a * size + 6 + masses + link] = -others[a];
            }
        }
    }

    void go_on() {
        store(f.attitude, matrix3(f.turn_before) * matrix3(f.attitude));
        store(f.turn_before, multiple(1.0));
        zero(f.state, 3);
    }

    double off(Index axis) const {
        double rotation_vector[3];
        store(rotation_vector, logarithm(matrix3(f.measured_orientation) * transposed(matrix3(f.attitude))));
        return rotation_vector[axis] - f.aside[axis] - f.state[axis];
    }

    // The small turn that the filter has found.
    void take_correction() {
        store(f.attitude, exponential(vector3(f.state)) * matrix3(f.attitude));
        zero(f.state, 3);
    }

    // The bodies of the masses found.
    void adapt() {
        const double *of_masses = f.state + 6, *of_inertias = of_masses + masses;
        for (Index link = 0; link < masses; ++link) {
            const double factor = 1 + of_masses[link];
            const Vector3 first = vector3(nominal.first + 3 * link);
            f.body_mass[link] = factor * nominal.mass[link];
            store(f.body_first + 3 * link, factor * first);
            Matrix3 second = (1 + of_inertias[link]) * matrix3(nominal.second + 9 * link);
            if (nominal.mass[link] > 0)
                second = second + (of_masses[link] - of_inertias[link]) / nominal.mass[link] * outer(first, first);
            store(f.body_second + 9 * link, second);
        }
    }

    // Torques at the first instants, from joints that are placed and accelerate there.
    void find_moments() {
        const Matrix3 attitude = matrix3(f.turn_after) * matrix3(f.attitude);
        double entries[9];
        store(entries, attitude);
        for (Index e = 0; e < 9; ++e)
            for (Index k = 0; k < LANES; ++k) look.attitude[e * look.stride + k] = entries[e];
        move_tree(flies, look, true);
        find_rates(flies, look, 0, everywhere<Threes>(f.state + 3));
        drive_tree(flies, look, 0);
    }

  private:
    const SpatialTree &nominal;
    const SpatialBody body;  // of the masses found
    const InSpace flies;
    CorrectedFlight &f;
    SpatialAt look{};
    Turned turned{};
    TurningWorkspace room{};
    double *inertia, *relative, *joint_map;  // (instants, 3, 3), (instants, 3), (joints, 3)
    double *per_momentum, *of_base;          // (3, 3): I^-1 and I in the world's axes, where something is measured

    // Moments of inertia of a link about its own centre of mass, in its axes.
    Matrix3 own_inertia(Index link) const {
        const Vector3 first = vector3(nominal.first + 3 * link);
        const Matrix3 second = matrix3(nominal.second + 9 * link);
        return less_than_trace(second - 1 / nominal.mass[link] * outer(first, first));
    }

    // A of the planned joints at an instant.
    void find_joint_map(Index k) {
        const Index first = k / LANES * LANES, lane = k % LANES;
        move_bodies(body.tree, TreeJoints{look, first, nothing(), false}, look.bodies);
        const MomentumMaps maps(look.bodies);
        zero(joint_map, 3 * joints);
        for (Index j = 0; j < body.tree.joints; ++j) {
            if (body.first[j] == body.first[j + 1]) continue;
            double own[3];
            store(own, lane_of(maps.of_joint(j), lane));
            for (Index e = body.first[j]; e < body.first[j + 1]; ++e)
                add(body.ratio[e], own, 3, joint_map + 3 * body.planned[e]);
        }
    }

    // By how much the base turns in `dt` s from the attitude of the filter, over the stages from one on; NaN where that
    // cannot be integrated.
    void turn_for(Index from, double dt, double *rotation) {
        Turning &t = turned.cells;
        const Cells &rule = f.gap_cells;
        t.cells = 1;
        set_rule(t, rule, body);
        t.duration = dt;
        t.momentum = f.state + 3;
        t.inertia = inertia + 9 * from;
        t.relative = relative + 3 * from;
        t.columns = 0;
        t.instants = 0;
        copy(t.borders, f.attitude, 9);
        if (!turn_cells(t, Asked::attitudes, room)) return std::fill(rotation, rotation + 9, NAN);
        // Of a rotation from rounding on, by way of its vector: else what it lacks to be one grows with each measurement.
        store(rotation, exponential(logarithm(matrix3(t.ends) * transposed(matrix3(f.attitude)))));
    }
};
