// Where the bodies of a tree in space are, which of their points is lowest, and how a limb is bent to bring its last body
// to a pose.

// The frames of all bodies in the world; 1 where there was no memory.
Index place_bodies(const SpatialTree &tree, const SpatialPoses &poses) {
    const Index n = tree.joints, bodies = n + 2;
    BodyFrame *frames;
    Workspace room;
    if (!room.make([&](Arena &arena) { arena.take(frames, n + 1); })) return 1;
    for (Index k = 0; k < poses.instants; k += LANES) {
        const Instants instants(k, poses.instants);
        frames[0] = {instants.load9(poses.attitudes), instants.load3(poses.base)};
        Threes along;
        for (Index j = 0; j < n; ++j)
            frames[j + 1] = moved_frame(tree, j, frames[tree.parent[j]], instants.load(poses.positions + j, n), along);
        for (Index body = 0; body <= n; ++body) {
            double *place = poses.places + 3 * (body + 1), *rotation = poses.rotations + 9 * (body + 1);
            instants.store3(place, 3 * bodies, 1, frames[body].place);
            for (Index row = 0; row < 3; ++row)
                instants.store3(rotation + 3 * row, 9 * bodies, 1, frames[body].turned.row[row]);
        }
    }
    return 0;
}

// The lowest point of one solid in the world: a corner of its hull, and from there that of the ellipsoid.
static inline Threes lowest_of_solid(const PlacedSolids &of, Index solid, const BodyFrame &body) {
    const Threes down = -body.turned.row[2];  // in the body's frame
    Vector farthest = all(-INFINITY), number = all(0);
    for (Index p = of.first[solid]; p < of.first[solid + 1]; ++p) {
        const Vector reach = dot(down, triple<Vector>(of.points + 3 * p));
        const Bits farther = reach > farthest;
        farthest = select(farther, reach, farthest);
        number = select(farther, all(static_cast<double>(p)), number);
    }
    Threes local;
    for (Index lane = 0; lane < LANES; ++lane) {
        const double *corner = of.points + 3 * static_cast<Index>(number[lane]);
        local.x[lane] = corner[0], local.y[lane] = corner[1], local.z[lane] = corner[2];
    }
    const Nines axes = square<Vector>(of.axes + 9 * solid);
    const Threes along = down * axes;
    const Vector length = square_root(dot(along, along));
    const Vector per_length = select(length > all(0), all(1) / length, all(0));
    return body.place + body.turned * (local + axes * (per_length * along));
}

// Of the solids of each group at all instants; 1 where there was no memory.
Index lowest_points(const PlacedSolids &of) {
    Threes *lowest;
    Workspace room;
    if (!room.make([&](Arena &arena) { arena.take(lowest, of.groups); })) return 1;
    for (Index first = 0; first < of.instants; first += LANES) {
        const Instants k(first, of.instants);
        for (Index group = 0; group < of.groups; ++group) lowest[group] = {all(0), all(0), all(INFINITY)};
        for (Index solid = 0; solid < of.solids; ++solid) {
            const Index body = of.body[solid];
            const Threes point = lowest_of_solid(of, solid,
                                                 {k.load9(of.rotations + 9 * body, 9 * of.bodies),
                                                  k.load3(of.places + 3 * body, 3 * of.bodies)});
            Threes &least = lowest[of.group[solid]];
            const Bits lower = point.z < least.z;
            least = {select(lower, point.x, least.x), select(lower, point.y, least.y), select(lower, point.z, least.z)};
        }
        for (Index group = 0; group < of.groups; ++group)
            k.store3(of.lowest + 3 * group, 3 * of.groups, 1, lowest[group]);
    }
    return 0;
}

// How far points that are no higher than their group's level reach in each direction: minus infinity where there is none.
// Of a ball about a point, what is below that counts for its height.
Index reach_on_ground(const PlacedSolids &of) {
    for (Index k = 0; k < of.instants; ++k) {
        double *reach = of.reach + k * of.directions;
        for (Index d = 0; d < of.directions; ++d) reach[d] = -INFINITY;
        for (Index solid = 0; solid < of.solids; ++solid) {
            const Index body = k * of.bodies + of.body[solid];
            const Vector3 place = vector3(of.places + 3 * body);
            const Matrix3 turned = matrix3(of.rotations + 9 * body);
            const Vector3 below = turned.row[2] * matrix3(of.axes + 9 * solid);
            const double level = of.levels[k * of.groups + of.group[solid]] + std::sqrt(dot(below, below)) - place.z;
            for (Index p = of.first[solid]; p < of.first[solid + 1]; ++p) {
                const Vector3 point = vector3(of.points + 3 * p);
                if (!(dot(turned.row[2], point) < level)) continue;
                const double x = place.x + dot(turned.row[0], point), y = place.y + dot(turned.row[1], point);
                for (Index d = 0; d < of.directions; ++d)
                    reach[d] = larger(x * of.direction[2 * d] + y * of.direction[2 * d + 1], reach[d]);
            }
        }
    }
    return 0;
}

// The vector (3) of a rotation, rad, twice that of its quaternion: to the third order, and growing up to half a turn.
static inline Threes small_turn(const Nines &rotation) {
    const Triple<Vector> *row = rotation.row;
    const Vector trace = row[0].x + row[1].y + row[2].z;
    const Vector twice_cosine = square_root(larger(all(1) + trace, all(1e-6)));
    return (all(1) / twice_cosine) * Threes{row[2].y - row[1].z, row[0].z - row[2].x, row[1].x - row[0].y};
}

// Solves a x = b (6) of a positive definite a, by Cholesky's factors; a is overwritten.
static inline void solve_six(Vector (&a)[6][6], Vector (&b)[6]) {
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < i; ++j) {
            for (int k = 0; k < j; ++k) a[i][j] -= a[i][k] * a[j][k];
            a[i][j] /= a[j][j];
        }
        for (int k = 0; k < i; ++k) a[i][i] -= a[i][k] * a[i][k];
        a[i][i] = square_root(a[i][i]);
    }
    for (int i = 0; i < 6; ++i) {
        for (int k = 0; k < i; ++k) b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = 6; i-- > 0;) {
        for (int k = i + 1; k < 6; ++k) b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

// A limb at several instants.
struct Limb {
    Vector *position;        // (links)
    Threes *along, *origin;  // (links): each joint's axis in the world, and where it is
    Moving *rate;            // (links): of the point and the last body's attitude, by the joint

    void lay_out(Arena &arena, Index links) {
        arena.take(position, links), arena.take(along, links), arena.take(origin, links), arena.take(rate, links);
    }
};

// One step of Levenberg and Marquardt: the miss (6) is taken away by the smallest change J^T (J J^T + damping)^-1 miss.
// The damping grows with the miss (Fan and Yuan 2005, Computing 74, 23) times the lever of the joints, which bounds how
// the miss curves: without it a limb that is straight, and too short for its target, would swing to and fro.
// Returns the largest change of a joint, rad.
static inline Vector bend_once(const SpatialTree &tree, const LimbTargets &targets, const Instants &k, Limb &limb) {
    BodyFrame frame = {k.load9(targets.attitudes), k.load3(targets.base)};
    for (Index i = 0; i < targets.links; ++i) {
        frame = moved_frame(tree, targets.chain[i], frame, limb.position[i], limb.along[i]);
        limb.origin[i] = frame.place;
    }
    const Vector weight = all(targets.turn_weight);
    const Threes point = frame.place + frame.turned * k.load3(targets.local);
    const Moving miss = {k.load3(targets.target) - point,
                         weight * small_turn(k.load9(targets.attitude) * transposed(frame.turned))};
    Vector normal[6][6], right[6] = {miss.linear.x,  miss.linear.y,  miss.linear.z,
                                     miss.angular.x, miss.angular.y, miss.angular.z};
    for (int a = 0; a < 6; ++a)
        for (int b = 0; b <= a; ++b) normal[a][b] = all(0);
    Vector lever = all(0);
    for (Index i = 0; i < targets.links; ++i) {
        if (!targets.moves[i]) continue;
        const Threes along = limb.along[i];
        limb.rate[i] = tree.slides[targets.chain[i]]
                           ? Moving{along, nothing()}
                           : Moving{cross(along, point - limb.origin[i]), weight * along};
        const Moving &rate = limb.rate[i];
        lever += dot(rate.linear, rate.linear);
        const Vector of[] = {rate.linear.x,  rate.linear.y,  rate.linear.z,
                             rate.angular.x, rate.angular.y, rate.angular.z};
        for (int a = 0; a < 6; ++a)
            for (int b = 0; b <= a; ++b) normal[a][b] += of[a] * of[b];
    }
    const Vector damping = all(targets.damping) + square_root(dot(miss.linear, miss.linear) * lever);
    for (int a = 0; a < 6; ++a) normal[a][a] += damping;
    solve_six(normal, right);
    const Moving pull = {{right[0], right[1], right[2]}, {right[3], right[4], right[5]}};
    Vector largest = all(0);
    for (Index i = 0; i < targets.links; ++i) {
        if (!targets.moves[i]) continue;
        const Vector step = dot(limb.rate[i], pull);
        limb.position[i] += step;
        largest = larger(largest, larger(step, -step));
    }
    return largest;
}

// Positions of a limb's joints at all instants; 1 where there was no memory.
Index bend_limb(const SpatialTree &tree, const LimbTargets &targets) {
    const Index links = targets.links;
    Limb limb;
    Workspace room;
    if (!room.make([&](Arena &arena) { limb.lay_out(arena, links); })) return 1;
    for (Index first = 0; first < targets.instants; first += LANES) {
        const Instants k(first, targets.instants);
        for (Index i = 0; i < links; ++i) limb.position[i] = k.load(targets.positions + i, links);
        for (Index sweep = 0; sweep < targets.sweeps; ++sweep)
            if (!any(bend_once(tree, targets, k, limb) >= all(targets.settled))) break;
        for (Index i = 0; i < links; ++i) k.store(targets.positions + i, links, limb.position[i]);
    }
    return 0;
}
