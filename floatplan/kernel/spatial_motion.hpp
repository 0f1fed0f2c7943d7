// A tree in space at several instants at once: its joints, the rates of its base, torques, and how the rates change with the
// joints.
//
// With I, A and L of space.hpp, W the world's axes and B the base's, the base turns at
//
//     w_B = I^-1 (R_WB^T h_W - A q'),                                                                                 (S1)
//
// where h_W is the angular momentum about the CM, kg m^2/s, and R_WB the attitude. With small turns zeta of the world's axes,
// dR = [zeta]x R,
//
//     dw_B = -I^-1 (L dq + A dq') + I^-1 R^T (dh_W + [h_W]x zeta),                                                    (S3)
//
// of which RateSlopes have the first part, by positions and speeds of the joints that are planned.

// What flies, and the cells of the levels.
struct InSpace {
    const SpatialBody &spatial_body;
    const Cells *cells;
    Index joints;
};

// The joints of the tree and the base at instants; w_B and what it takes to differentiate it. (3, ..), (9, ..) by rows.
struct SpatialAt {
    Index stride;
    Motion motion;                            // of the planned joints; its rate is |w_B|, its moments are torques
    double *position, *speed, *acceleration;  // (tree joints, stride)
    double *rates, *inverse, *attitude;       // (3, stride), (9, stride), (9, stride): w_B, I^-1, R_WB
    SpatialBodies bodies;
};

// The joints of a tree at the instants computed at once, with the base at given rates.
struct TreeJoints {
    const SpatialAt &at;
    const Index k;
    const Threes w_B;
    const bool accelerates;

    Vector position(Index j) const { return load(at.position + j * at.stride + k); }
    Vector speed(Index j) const { return load(at.speed + j * at.stride + k); }
    Vector acceleration(Index j) const { return load(at.acceleration + j * at.stride + k); }
    bool accelerate() const { return accelerates; }
    Threes rates() const { return w_B; }
};

static inline Threes threes(const double *from, Index stride, Index k) {
    return {load(from + k), load(from + stride + k), load(from + 2 * stride + k)};
}
static inline Nines nines(const double *from, Index stride, Index k) {
    return {{threes(from, stride, k), threes(from + 3 * stride, stride, k), threes(from + 6 * stride, stride, k)}};
}
static inline void store(double *to, Index stride, Index k, Threes value) {
    store(to + k, value.x);
    store(to + stride + k, value.y);
    store(to + 2 * stride + k, value.z);
}
static inline void store(double *to, Index stride, Index k, const Nines &value) {
    for (Index row = 0; row < 3; ++row) store(to + 3 * row * stride, stride, k, value.row[row]);
}

// One of the instants that are computed at once.
static inline Vector3 lane_of(Threes value, Index lane) { return {value.x[lane], value.y[lane], value.z[lane]}; }
static inline Matrix3 lane_of(const Nines &value, Index lane) {
    return {{lane_of(value.row[0], lane), lane_of(value.row[1], lane), lane_of(value.row[2], lane)}};
}
static inline void set_lane(Threes &to, Index lane, const double *from) {
    to.x[lane] = from[0];
    to.y[lane] = from[1];
    to.z[lane] = from[2];
}
static inline void set_lane(Nines &to, Index lane, const double *from) {
    for (Index row = 0; row < 3; ++row) set_lane(to.row[row], lane, from + 3 * row);
}

static inline void lay_out_in_space(Arena &arena, SpatialAt &at, const InSpace &body, Index capsules, Index instants) {
    const Index n = body.joints, J = body.spatial_body.tree.joints;
    Motion &m = at.motion;
    m.instants = instants;
    m.stride = at.stride = (instants + 7) / 8 * 8;
    for (double **each : {&m.position, &m.sine, &m.cosine, &m.p_rate, &m.p_curvature, &m.speed, &m.acceleration})
        arena.take(*each, n * at.stride);
    for (double **each : {&m.time, &m.rate}) arena.take(*each, at.stride);
    for (double **each : {&m.end_x, &m.end_y, &m.end_z}) arena.take(*each, 2 * capsules * at.stride);
    arena.take(m.weights, 8 * Terms{n, J}.count());
    for (double **each : {&m.moment, &at.position, &at.speed, &at.acceleration}) arena.take(*each, J * at.stride);
    arena.take(at.rates, 3 * at.stride);
    for (double **each : {&at.inverse, &at.attitude}) arena.take(*each, 9 * at.stride);
    at.bodies.lay_out(arena, J);
}

// The tree's joints from the planned ones.
static inline void move_tree(const InSpace &body, SpatialAt &at, bool accelerates) {
    const SpatialBody &spatial_body = body.spatial_body;
    const Motion &m = at.motion;
    for (Index j = 0; j < spatial_body.tree.joints; ++j)
        for (Index k = 0; k < m.instants; k += LANES) {
            Vector position = all(spatial_body.reference[j]), speed = all(0), acceleration = all(0);
            for (Index e = spatial_body.first[j]; e < spatial_body.first[j + 1]; ++e) {
                const Index from = spatial_body.planned[e] * at.stride + k;
                position = add_product(spatial_body.ratio[e], load(m.position + from), position);
                speed = add_product(spatial_body.ratio[e], load(m.speed + from), speed);
                acceleration = add_product(spatial_body.ratio[e], load(m.acceleration + from), acceleration);
            }
            store(at.position + j * at.stride + k, position);
            store(at.speed + j * at.stride + k, speed);
            if (accelerates) store(at.acceleration + j * at.stride + k, acceleration);
        }
}

// Torques at the instants computed at once, where w_B is known; slopes of them are then known in at.bodies.
static inline void drive_tree(const InSpace &body, SpatialAt &at, Index k) {
    const TreeJoints joints{at, k, threes(at.rates, at.stride, k), true};
    move_bodies(body.spatial_body.tree, joints, at.bodies);
    free_torques(body.spatial_body.tree, joints, at.bodies,
                 [&](Index j, Vector torque) { store(at.motion.moment + j * at.stride + k, torque); });
}

// w_B by (S1) at the instants computed at once, from the attitude there; and its length.
static inline void find_rates(const InSpace &body, SpatialAt &at, Index k, Threes h_W) {
    move_bodies(body.spatial_body.tree, TreeJoints{at, k, nothing(), false}, at.bodies);
    const MomentumMaps maps(at.bodies);
    const Nines inverse_inertia = inverse(maps.inertia());
    const Threes w_B = inverse_inertia * (h_W * nines(at.attitude, at.stride, k) - maps.momentum());
    store(at.inverse, at.stride, k, inverse_inertia);
    store(at.rates, at.stride, k, w_B);
    store(at.motion.rate + k, square_root(dot(w_B, w_B)));
}

// The centre of mass in the world at the instants computed at once.
static inline Threes com_at(const Constraints &constraints, const SpatialAt &at, Index k) {
    const double *path = constraints.path;
    const Vector t = load(at.motion.time + k);
    const Threes fallen = {all(0), all(0), all(path[6] / 2) * t * t};
    return everywhere<Threes>(path) + t * everywhere<Threes>(path + 3) - fallen;
}

// The point of a hull that is farthest along a unit vector, in its body's axes.
static inline Threes lowest_of_hull(const Constraints &constraints, Index hull, Threes down) {
    Threes farthest = nothing(), grown = nothing();
    Vector reach = all(-HUGE_VAL), squared = all(0);
    for (Index point = constraints.hull_first[hull]; point < constraints.hull_first[hull + 1]; ++point) {
        const Threes at = everywhere<Threes>(constraints.hull_points + 3 * point);
        const Vector along = dot(at, down);
        const Bits is_farther = along > reach;
        reach = select(is_farther, along, reach);
        farthest = select(is_farther, at, farthest);
    }
    for (Index i = 0; i < 3; ++i) {
        const Threes axis = everywhere<Threes>(constraints.hull_axes + 9 * hull + 3 * i);
        const Vector along = dot(axis, down);
        grown = grown + along * axis;
        squared += along * along;
    }
    return farthest + 1 / square_root(larger(squared, all(1e-300))) * grown;
}

// Ends of the capsules in the world at the instants computed at once, from bodies and attitude there.
static inline void place_capsules(const Constraints &constraints, SpatialAt &at, Index k) {
    const Motion &m = at.motion;
    const Threes com_W = com_at(constraints, at, k), com_B = MomentumMaps(at.bodies).center;
    const Nines R_WB = nines(at.attitude, at.stride, k);
    const auto place = [&](Index end, Threes own) {
        const Index body = constraints.body[end / 2];
        const Threes place_B = at.bodies.place[body] + at.bodies.turned[body] * own;
        const Threes place_W = com_W + R_WB * (place_B - com_B);
        store(m.end_x + end * at.stride + k, place_W.x);
        store(m.end_y + end * at.stride + k, place_W.y);
        store(m.end_z + end * at.stride + k, place_W.z);
    };
    const Index capsules = constraints.capsules - constraints.hulls;
    for (Index end = 0; end < 2 * capsules; ++end) place(end, everywhere<Threes>(constraints.ends + 3 * end));
    for (Index hull = 0; hull < constraints.hulls; ++hull) {
        const Index end = 2 * (capsules + hull);
        const Threes down = -(R_WB.row[2] * at.bodies.turned[constraints.body[end / 2]]);
        const Threes lowest = lowest_of_hull(constraints, hull, down);
        place(end, lowest);
        place(end + 1, lowest);
    }
}

// How the bodies and the centre of mass move with the tree's joints, by the base's axes and origin: (6, ..) and (3, ..).
struct Moves {
    double *of_carried, *of_com;  // (tree joints, 6, stride), (tree joints, 3, stride)
    double *com;                  // (3, stride)
    Index *is_known;              // (stride / 8)
    Index stride;

    void lay_out(Arena &arena, Index joints, Index instants) {
        arena.take(of_carried, 6 * joints * instants);
        arena.take(of_com, 3 * joints * instants);
        arena.take(com, 3 * instants);
        arena.take(is_known, instants / 8);
    }

    void forget(Index instants) {
        stride = instants;
        std::fill(is_known, is_known + stride / 8, 0);
    }

    // At the 8 instants about k.
    void find(const InSpace &body, SpatialAt &at, Index k) {
        if (std::exchange(is_known[k / 8], 1)) return;
        const SpatialTree &tree = body.spatial_body.tree;
        for (Index from = k / 8 * 8; from < k / 8 * 8 + 8; from += LANES) {
            move_bodies(tree, TreeJoints{at, from, nothing(), false}, at.bodies);
            const MomentumMaps maps(at.bodies);
            store(com, stride, from, maps.center);
            for (Index j = 0; j < tree.joints; ++j) {
                const Moving axis = at.bodies.axis[j];
                store(of_carried + 6 * j * stride, stride, from, axis.linear);
                store(of_carried + (6 * j + 3) * stride, stride, from, axis.angular);
                const Moving moved = at.bodies.carried[j + 1].of_acceleration(axis);
                store(of_com + 3 * j * stride, stride, from, maps.per_mass * moved.linear);
            }
        }
    }

    // Adds to `of_tree` (joints) what moves of a point of a body are along a vector, in the base's axes.
    void weigh(const SpatialTree &tree, Index body, Threes place, Threes along, Index k, Vector *of_tree) const {
        const Moving by = {along, cross(place, along)};
        for (; body > 0; body = tree.parent[body - 1]) {
            const double *own = of_carried + 6 * (body - 1) * stride;
            of_tree[body - 1] += dot(Moving{threes(own, stride, k), threes(own + 3 * stride, stride, k)}, by);
        }
    }

    // The same of the centre of mass.
    void weigh_com(const SpatialTree &tree, Threes along, Index k, Vector *of_tree) const {
        for (Index j = 0; j < tree.joints; ++j) of_tree[j] += dot(threes(of_com + 3 * j * stride, stride, k), along);
    }
};

// How w_B changes with the planned joints' positions and speeds where zeta and h are held: (3, joints, stride) each.
struct RateSlopes {
    double *by_position, *by_speed;
    Index joints, stride;

    void lay_out(Arena &arena, Index count, Index instants) {
        joints = count;
        for (double **each : {&by_position, &by_speed}) arena.take(*each, 3 * joints * instants);
    }

    // -I^-1 L and -I^-1 A at the instants computed at once.
    void find(const InSpace &body, SpatialAt &at, Index k) {
        const SpatialBody &spatial_body = body.spatial_body;
        const Index apart = joints * stride;
        move_bodies(spatial_body.tree, TreeJoints{at, k, threes(at.rates, at.stride, k), false}, at.bodies);
        const MomentumMaps maps(at.bodies);
        const Nines inverse_inertia = nines(at.inverse, at.stride, k);
        for (double *each : {by_position, by_speed})
            for (Index e = 0; e < 3 * joints; ++e) store(each + e * stride + k, all(0));
        for (Index j = 0; j < spatial_body.tree.joints; ++j) {
            if (spatial_body.first[j] == spatial_body.first[j + 1]) continue;
            const Threes position = -(inverse_inertia * maps.slope(j)), speed = -(inverse_inertia * maps.of_joint(j));
            for (Index e = spatial_body.first[j]; e < spatial_body.first[j + 1]; ++e) {
                const Vector ratio = all(spatial_body.ratio[e]);
                double *of_position = by_position + spatial_body.planned[e] * stride;
                double *of_speed = by_speed + spatial_body.planned[e] * stride;
                store(of_position, apart, k, threes(of_position, apart, k) + ratio * position);
                store(of_speed, apart, k, threes(of_speed, apart, k) + ratio * speed);
            }
        }
    }

    // What weights of w_B make of positions and speeds (2, joints).
    void weigh(Index k, Threes weights, Vector *by_joint) const {
        const Index apart = joints * stride;
        for (Index i = 0; i < joints; ++i) {
            by_joint[i] = dot(weights, threes(by_position + i * stride, apart, k));
            by_joint[joints + i] = dot(weights, threes(by_speed + i * stride, apart, k));
        }
    }
};
