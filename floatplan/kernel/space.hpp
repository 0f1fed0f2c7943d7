// A tree of bodies on a free base in space: its momentum about the centre of mass and the joints' torques in free flight,
// with their derivatives. All of it in the base's axes, the base's origin being at rest for an instant.
//
// S_j is how joint j moves what it carries, I^C the inertia of that, and f^C the force on it. Derivatives as by Singh,
// Russell and Wensing (IEEE Robotics and Automation Letters 7 (2022) 1776): with P_j = v x S_j and Q_j = a x S_j + v x P_j of
// the body before j, dS_j/dt = v_j x S_j, and D^C what I^C does to a velocity by its own one,
//
//     d f^C / dq_j  = D^C P_j + I^C Q_j + S_j x* f^C,    d f^C / dq'_j = D^C S_j + I^C (P_j + dS_j/dt).

using Nines = Square<Vector>;  // at several instants at once, as Threes
using Moving = Spatial<Vector>;

static inline Threes nothing() { return {all(0), all(0), all(0)}; }

// Instants that are computed at once, the last one again where there are no more.
struct Instants {
    Index at[LANES], count;

    Instants(Index first, Index all_of_them) : count(all_of_them - first) {
        for (Index lane = 0; lane < LANES; ++lane) at[lane] = first + (lane < count ? lane : count - 1);
    }
    Vector load(const double *from, Index stride) const {
        Vector value;
        for (Index lane = 0; lane < LANES; ++lane) value[lane] = from[at[lane] * stride];
        return value;
    }
    Threes load3(const double *from, Index stride = 3) const {
        return {load(from, stride), load(from + 1, stride), load(from + 2, stride)};
    }
    Nines load9(const double *from, Index stride = 9) const {
        return {{load3(from, stride), load3(from + 3, stride), load3(from + 6, stride)}};
    }
    void store(double *to, Index stride, Vector value) const {
        for (Index lane = 0; lane < LANES && lane < count; ++lane) to[at[lane] * stride] = value[lane];
    }
    void store3(double *to, Index stride, Index apart, Threes value) const {
        store(to, stride, value.x), store(to + apart, stride, value.y), store(to + 2 * apart, stride, value.z);
    }
};

// What is carried, by sums over its masses m at x that move with u: m, m x, m x x^T, m u, m x x u, m u x^T; and its force.
struct Carried {
    Vector mass;
    Threes first;
    Nines second;
    Threes momentum, angular_momentum;
    Nines flux;
    Moving force;

    void take(const Carried &more) {
        mass += more.mass;
        first = first + more.first;
        second = second + more.second;
        momentum = momentum + more.momentum;
        angular_momentum = angular_momentum + more.angular_momentum;
        flux = flux + more.flux;
        force = force + more.force;
    }
    Moving of_acceleration(Moving a) const {  // I^C a
        return {mass * a.linear + cross(a.angular, first), cross(first, a.linear) + less_than_trace(second) * a.angular};
    }
    Moving of_velocity(Moving v) const {  // D^C v
        return {all(2) * cross(v.angular, momentum), all(2) * (less_than_trace(flux) * v.angular)};
    }
    Moving back(Moving v) const {  // D^C transposed
        return {nothing(), all(2) * (cross(momentum, v.linear) + v.angular * less_than_trace(flux))};
    }
};

struct SpatialBodies {
    Nines *turned;                     // (joints + 1)
    Threes *place;                     // (joints + 1)
    Moving *velocity, *acceleration;   // (joints + 1)
    Carried *carried;                  // (joints + 1)
    Moving *axis, *before, *twice_before, *own;  // (joints): S, P, Q, P + dS/dt
    Moving *by;  // (3 joints + 3): forces on all bodies by positions, velocities, accelerations, the base's rates
    Vector *slopes;  // (joints, 3 joints + 3)

    void lay_out(Arena &arena, Index joints) {
        arena.take(turned, joints + 1), arena.take(place, joints + 1);
        arena.take(velocity, joints + 1), arena.take(acceleration, joints + 1), arena.take(carried, joints + 1);
        for (Moving **each : {&axis, &before, &twice_before, &own}) arena.take(*each, joints);
        arena.take(by, 3 * joints + 3), arena.take(slopes, joints * (3 * joints + 3));
    }
};

// All of one body, but what it carries.
static inline Carried own_body(const SpatialTree &tree, const SpatialBodies &at, Index body) {
    const Nines turned = at.turned[body];
    const Threes place = at.place[body], own = turned * triple<Vector>(tree.first + 3 * body);
    const Moving v = at.velocity[body];
    Carried it;
    it.mass = all(tree.mass[body]);
    it.first = it.mass * place + own;
    it.second = turned * square<Vector>(tree.second + 9 * body) * transposed(turned) + outer(own, place) +
                outer(place, it.first);
    it.momentum = it.mass * v.linear + cross(v.angular, it.first);
    it.angular_momentum = cross(it.first, v.linear) + less_than_trace(it.second) * v.angular;
    it.flux = outer(v.linear, it.first) + cross_matrix(v.angular) * it.second;
    const Moving of_rates = {cross(v.angular, it.momentum), less_than_trace(it.flux) * v.angular};
    it.force = it.of_acceleration(at.acceleration[body]) + of_rates;
    return it;
}

// Joints and the base's rates as SpatialMotion holds them.
struct JointsOfMotion {
    const SpatialMotion &m;
    const Instants &k;
    const Index n;

    Vector position(Index j) const { return k.load(m.positions + j, n); }
    Vector speed(Index j) const { return k.load(m.velocities + j, n); }
    Vector acceleration(Index j) const { return k.load(m.accelerations + j, n); }
    bool accelerate() const { return m.accelerations; }
    Threes rates() const { return m.rates ? k.load3(m.rates) : nothing(); }
};

// Of a body: its attitude, and where its origin is.
struct BodyFrame {
    Nines turned;
    Threes place;
};

// That of the body which joint j moves, at its position q on the body before it; `along` is the joint's axis there.
static inline BodyFrame moved_frame(const SpatialTree &tree, Index j, const BodyFrame &before, Vector q, Threes &along) {
    const Threes axis = triple<Vector>(tree.axis + 3 * j);
    BodyFrame frame = {before.turned * square<Vector>(tree.turned + 9 * j),
                       before.place + before.turned * triple<Vector>(tree.placed + 3 * j)};
    along = frame.turned * axis;
    if (tree.slides[j]) {
        frame.place = frame.place + q * along;
    } else {
        Vector s, c;
        sine_cosine(q, s, c);
        frame.turned = frame.turned * (multiple(c) + s * cross_matrix(axis) + (all(1) - c) * outer(axis, axis));
    }
    return frame;
}

// Where the bodies are and how they move, the base without acceleration, and what each carries.
template <typename Joints>
static inline void move_bodies(const SpatialTree &tree, const Joints &joints, SpatialBodies &at) {
    const Index n = tree.joints;
    at.turned[0] = multiple(all(1)), at.place[0] = nothing();
    at.velocity[0] = {nothing(), joints.rates()};
    at.acceleration[0] = {nothing(), nothing()};
    for (Index j = 0; j < n; ++j) {
        const Index from = tree.parent[j], to = j + 1;
        const Vector q = joints.position(j), speed = joints.speed(j);
        Threes along;
        const BodyFrame frame = moved_frame(tree, j, {at.turned[from], at.place[from]}, q, along);
        const Moving of = tree.slides[j] ? Moving{along, nothing()} : Moving{cross(frame.place, along), along};
        const Moving v = at.velocity[from] + speed * of, turning = cross(v, of);
        at.axis[j] = of;
        at.before[j] = cross(at.velocity[from], of);
        at.twice_before[j] = cross(at.acceleration[from], of) + cross(at.velocity[from], at.before[j]);
        at.own[j] = at.before[j] + turning;
        at.turned[to] = frame.turned;
        at.place[to] = frame.place;
        at.velocity[to] = v;
        at.acceleration[to] = at.acceleration[from] + speed * turning;
        if (joints.accelerate()) at.acceleration[to] = at.acceleration[to] + joints.acceleration(j) * of;
    }
    for (Index body = 0; body <= n; ++body) at.carried[body] = own_body(tree, at, body);
    for (Index j = n; j-- > 0;) at.carried[tree.parent[j]].take(at.carried[j + 1]);
}

// Angular momentum about the centre of mass by the rates of the base and of the joints, and how it changes with the joints'
// positions: I, A and L.
struct MomentumMaps {
    const SpatialBodies &at;
    const Carried &whole;
    const Vector per_mass;
    const Threes center;

    explicit MomentumMaps(const SpatialBodies &at)
        : at(at), whole(at.carried[0]), per_mass(all(1) / whole.mass), center(per_mass * whole.first) {}

    Nines inertia() const { return less_than_trace(whole.second - outer(center, whole.first)); }
    Threes momentum() const { return whole.angular_momentum - cross(center, whole.momentum); }
    Threes of_joint(Index j) const {
        const Moving moved = at.carried[j + 1].of_acceleration(at.axis[j]);
        return moved.angular - cross(center, moved.linear);
    }
    Threes slope(Index j) const {
        const Carried &of = at.carried[j + 1];
        const Moving s = at.axis[j], moved = of.of_acceleration(s);
        const Moving by = cross_force(s, {of.momentum, of.angular_momentum}) +
                          of.of_acceleration(cross(at.velocity[j + 1], s));
        return by.angular - (cross(per_mass * moved.linear, whole.momentum) + cross(center, by.linear));
    }
};

static inline void momentum_maps(const SpatialTree &tree, const SpatialMotion &m, const Instants &k,
                                 const SpatialBodies &at) {
    const Index n = tree.joints;
    const MomentumMaps maps(at);
    const Nines inertia = maps.inertia();
    for (Index row = 0; row < 3; ++row) k.store3(m.inertia + 3 * row, 9, 1, inertia.row[row]);
    for (Index j = 0; j < n; ++j) {
        k.store3(m.joint_map + j, 3 * n, n, maps.of_joint(j));
        if (m.slopes) k.store3(m.slopes + j, 3 * n, n, maps.slope(j));
    }
}

// The base's acceleration that takes a force on all bodies away.
struct Free {
    Vector per_mass;
    Threes center;
    Nines per_inertia;

    explicit Free(const Carried &whole) : per_mass(all(1) / whole.mass), center(per_mass * whole.first) {
        per_inertia = inverse(less_than_trace(whole.second - outer(center, whole.first)));
    }
    Moving yields(Moving force) const {
        const Threes turns = per_inertia * (cross(center, force.linear) - force.angular);
        return {cross(center, turns) - per_mass * force.linear, turns};
    }
};

// Torques, by their joints, to write(j, torque), and the base's acceleration; after it, forces are those of free flight.
template <typename Joints, typename Write>
static inline Moving free_torques(const SpatialTree &tree, const Joints &joints, SpatialBodies &at, Write write) {
    const Moving base = Free(at.carried[0]).yields(at.carried[0].force);
    for (Index j = 0; j < tree.joints; ++j) {
        Carried &of = at.carried[j + 1];
        of.force = of.force + of.of_acceleration(base);
        at.twice_before[j] = at.twice_before[j] + cross(base, at.axis[j]);
        write(j, dot(at.axis[j], of.force) + all(tree.armature[j]) * joints.acceleration(j));
    }
    return base;
}

// Derivatives at.slopes (joints, 3 joints + 3) of the torques by positions, velocities, accelerations and the base's rates.
static inline void torque_slopes(const SpatialTree &tree, SpatialBodies &at) {
    const Index n = tree.joints, columns = 3 * n + 3, all_of_it = n * columns;
    Moving *by = at.by, base[3], moved[3];
    for (Index e = 0; e < 3; ++e) {
        const double unit[] = {double(e == 0), double(e == 1), double(e == 2)};
        base[e] = {nothing(), triple<Vector>(unit)}, moved[e] = cross(at.velocity[0], base[e]);
        by[3 * n + e] = at.carried[0].of_velocity(base[e]) + at.carried[0].of_acceleration(moved[e]);
    }
    for (Index i = 0; i < n; ++i) {
        const Carried &of = at.carried[i + 1];
        const Moving s = at.axis[i];
        by[i] = of.of_velocity(at.before[i]) + of.of_acceleration(at.twice_before[i]) + cross_force(s, of.force);
        by[n + i] = of.of_velocity(s) + of.of_acceleration(at.own[i]);
        by[2 * n + i] = of.of_acceleration(s);
    }
    Vector *slopes = at.slopes;
    zero((double *)slopes, all_of_it * LANES);
    for (Index i = 0; i < n; ++i) {
        const Moving heavy = by[2 * n + i], back = at.carried[i + 1].back(at.axis[i]);
        Vector *row = slopes + i * columns;
        for (Index body = i + 1; body > 0; body = tree.parent[body - 1]) {  // it, and what carries it
            const Index j = body - 1;
            row[j] = dot(back, at.before[j]) + dot(heavy, at.twice_before[j]);
            row[n + j] = dot(back, at.axis[j]) + dot(heavy, at.own[j]);
            row[2 * n + j] = dot(heavy, at.axis[j]);
            if (j == i) continue;
            for (Index d = 0; d < 3; ++d) slopes[j * columns + d * n + i] = dot(at.axis[j], by[d * n + i]);
        }
        for (Index e = 0; e < 3; ++e) row[3 * n + e] = dot(back, base[e]) + dot(heavy, moved[e]);
        row[2 * n + i] += all(tree.armature[i]);
    }
    const Free free(at.carried[0]);
    for (Index c = 0; c < columns; ++c) {
        const Moving yields = free.yields(by[c]);
        for (Index i = 0; i < n; ++i) slopes[i * columns + c] = slopes[i * columns + c] + dot(by[2 * n + i], yields);
    }
}

// What is asked at all instants; 1 where there was no memory.
Index move_in_space(const SpatialTree &tree, const SpatialMotion &motion) {
    SpatialBodies at;
    Workspace room;
    if (!room.make([&](Arena &arena) { at.lay_out(arena, tree.joints); })) return 1;
    for (Index k = 0; k < motion.instants; k += LANES) {
        const Instants instants(k, motion.instants);
        const JointsOfMotion joints{motion, instants, tree.joints};
        move_bodies(tree, joints, at);
        if (motion.inertia) momentum_maps(tree, motion, instants, at);
        if (!motion.torques) continue;
        const Moving base = free_torques(tree, joints, at, [&](Index j, Vector torque) {
            instants.store(motion.torques + j, tree.joints, torque);
        });
        instants.store3(motion.base_acceleration, 6, 1, base.linear);
        instants.store3(motion.base_acceleration + 3, 6, 1, base.angular);
        if (!motion.torque_slopes) continue;
        torque_slopes(tree, at);
        const Index entries = tree.joints * (3 * tree.joints + 3);
        for (Index e = 0; e < entries; ++e) instants.store(motion.torque_slopes + e, entries, at.slopes[e]);
    }
    return 0;
}
