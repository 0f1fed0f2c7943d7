// A flight in space, as Program<Flight> takes it; see planar_flight.hpp for what that is.
//
// With I, A and L of space.hpp, W the world's axes and B the base's, the base turns at
//
//     w_B = I^-1 (R_WB^T h_W - A q'),    R_WB' = R_WB [w_B]x,                                                        (S1)
//
// which turning.hpp integrates in the cells of a level. What the attitude at landing lacks is the vector of rotation
// log(R_goal^T R_WB(T)). By small turns zeta of the world's axes, dR = [zeta]x R,
//
//     zeta' = R I^-1 R^T [h]x zeta + g,    g = -R I^-1 (L dq + A dq') + R I^-1 R^T dh,                               (S2)
//     dw = -I^-1 (L dq + A dq') + I^-1 R^T (dh + [h]x zeta).
//
// The turn at landing is sum_j W_j g_j over the stages, with W_j that go backwards through the cells. Where rows or sums
// depend on w, by h, the turns at all instants are carried forwards instead.

// What flies, and the cells of the levels.
struct InSpace {
    const SpatialBody &given;
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
static inline Threes everywhere(const double *vector) { return triple<Vector>(vector); }

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

static inline void lay_out_in_space(Arena &arena, SpatialAt &at, const InSpace &body, Index instants) {
    const Index n = body.joints, J = body.given.tree.joints;
    Motion &m = at.motion;
    m.instants = instants;
    m.stride = at.stride = (instants + 7) / 8 * 8;
    for (double **each : {&m.position, &m.sine, &m.cosine, &m.p_rate, &m.p_curvature, &m.speed, &m.acceleration})
        arena.take(*each, n * at.stride);
    for (double **each : {&m.time, &m.rate}) arena.take(*each, at.stride);
    arena.take(m.weights, 8 * Terms{n, J}.count());
    for (double **each : {&m.moment, &at.position, &at.speed, &at.acceleration}) arena.take(*each, J * at.stride);
    arena.take(at.rates, 3 * at.stride);
    for (double **each : {&at.inverse, &at.attitude}) arena.take(*each, 9 * at.stride);
    at.bodies.lay_out(arena, J);
}

// The tree's joints from the planned ones.
static inline void move_tree(const InSpace &body, SpatialAt &at, bool accelerates) {
    const SpatialBody &given = body.given;
    const Motion &m = at.motion;
    for (Index j = 0; j < given.tree.joints; ++j)
        for (Index k = 0; k < m.instants; k += LANES) {
            Vector position = all(given.reference[j]), speed = all(0), acceleration = all(0);
            for (Index e = given.first[j]; e < given.first[j + 1]; ++e) {
                const Index from = given.planned[e] * at.stride + k;
                position = add_product(given.ratio[e], load(m.position + from), position);
                speed = add_product(given.ratio[e], load(m.speed + from), speed);
                acceleration = add_product(given.ratio[e], load(m.acceleration + from), acceleration);
            }
            store(at.position + j * at.stride + k, position);
            store(at.speed + j * at.stride + k, speed);
            if (accelerates) store(at.acceleration + j * at.stride + k, acceleration);
        }
}

// Torques at the instants computed at once, where w_B is known; slopes of them are then known in at.bodies.
static inline void drive_tree(const InSpace &body, SpatialAt &at, Index k) {
    const TreeJoints joints{at, k, threes(at.rates, at.stride, k), true};
    move_bodies(body.given.tree, joints, at.bodies);
    free_torques(body.given.tree, joints, at.bodies,
                 [&](Index j, Vector torque) { store(at.motion.moment + j * at.stride + k, torque); });
}

// w_B by (S1) at the instants computed at once, from the attitude there; and its length.
static inline void find_rates(const InSpace &body, SpatialAt &at, Index k, Threes h_W) {
    move_bodies(body.given.tree, TreeJoints{at, k, nothing(), false}, at.bodies);
    const MomentumMaps maps(at.bodies);
    const Nines inverse_inertia = inverse(maps.inertia());
    const Threes w_B = inverse_inertia * (h_W * nines(at.attitude, at.stride, k) - maps.momentum());
    store(at.inverse, at.stride, k, inverse_inertia);
    store(at.rates, at.stride, k, w_B);
    store(at.motion.rate + k, square_root(dot(w_B, w_B)));
}

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
        const SpatialBody &given = body.given;
        const Index apart = joints * stride;
        move_bodies(given.tree, TreeJoints{at, k, threes(at.rates, at.stride, k), false}, at.bodies);
        const MomentumMaps maps(at.bodies);
        const Nines inverse_inertia = nines(at.inverse, at.stride, k);
        for (double *each : {by_position, by_speed})
            for (Index e = 0; e < 3 * joints; ++e) store(each + e * stride + k, all(0));
        for (Index j = 0; j < given.tree.joints; ++j) {
            if (given.first[j] == given.first[j + 1]) continue;
            const Threes position = -(inverse_inertia * maps.slope(j)), speed = -(inverse_inertia * maps.of_joint(j));
            for (Index e = given.first[j]; e < given.first[j + 1]; ++e) {
                const Vector ratio = all(given.ratio[e]);
                double *of_position = by_position + given.planned[e] * stride;
                double *of_speed = by_speed + given.planned[e] * stride;
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

// The angles about the goal's axes on the way there: whether it makes the turns that are wanted, without tilting too far.
class TurnsMade {
  public:
    explicit TurnsMade(const SpatialBody &given) : given(given) {}

    // The next attitude (3, 3), less than half a turn from the one before.
    void take(const double *attitude) {
        if (!given.angles) return;
        Vector3 now = angles_about(given.angles, matrix3(attitude));
        steepest = larger(steepest, std::fabs(given.angles[0] == given.angles[2] ? now.y - turn / 4 : now.y));
        if (!has_begun) first = last = now;
        has_begun = true;
        now.x -= turn * std::round((now.x - last.x) / turn);
        now.z -= turn * std::round((now.z - last.z) / turn);
        last = now;
    }

    bool is_right() const {
        if (!given.angles) return true;
        const Vector3 change = last - first - vector3(given.change);
        const double most = larger(larger(std::fabs(change.x), std::fabs(change.y)), std::fabs(change.z));
        return most < given.wrong_turn && steepest <= given.most_tilt;
    }

  private:
    static constexpr double turn = 6.283185307179586;  // rad
    const SpatialBody &given;
    bool has_begun = false;
    double steepest = 0;
    Vector3 first{}, last{};
};

// How the base turns in the cells of a level.
struct Turned {
    Turning cells;
    double *inertia, *relative;  // (K, 3, 3), (K, 3)
    bool is_known;

    void lay_out(Arena &arena, Index most_nodes) {
        for (double **each : {&inertia, &cells.inverse, &cells.attitudes, &cells.turn_weights})
            arena.take(*each, 9 * most_nodes);
        for (double **each : {&relative, &cells.rates}) arena.take(*each, 3 * most_nodes);
        for (double **each : {&cells.still_rates, &cells.carried_rates}) arena.take(*each, 4 * most_nodes);
        for (double **each : {&cells.borders, &cells.ends, &cells.transitions}) arena.take(*each, 9 * most_nodes);
    }

    const double *landing() const { return cells.ends + 9 * (cells.cells - 1); }

    // R_WB at s in [0, 1], by the collocation's own polynomials.
    Matrix3 at(const Cells &rule, double s) const {
        const Index cell = std::min(static_cast<Index>(s * cells.cells), cells.cells - 1), S = cells.stages;
        double reached[MOST_STAGES];
        chebyshev_sums(rule.antiderivative, S + 1, S, s * cells.cells - cell, 1, reached);
        const double step = cells.duration / cells.cells;
        Matrix3 attitude = matrix3(cells.borders + 9 * cell);
        for (const double *rates : {cells.carried_rates, cells.still_rates}) {
            if (rates == cells.carried_rates && !is_pulled()) continue;
            double quaternion[] = {0, 0, 0, 1};
            for (Index k = 0; k < S; ++k) add(step * reached[k], rates + 4 * (cell * S + k), 4, quaternion);
            attitude = attitude * rotation(quaternion);
        }
        return attitude;
    }

    bool is_pulled() const {
        const Vector3 h = vector3(cells.momentum);
        return dot(h, h) > 0;
    }

    static constexpr Index MOST_STAGES = 16;
};

// Rows at any instants of a flight in space.
struct SpatialRows {
    using At = SpatialAt;
    const InSpace &body;
    const Constraints &constraints;
    const Series *series;
    const Turned *turned;
    const Cells *rule;

    Index count() const { return constraints.rows; }
    Terms terms() const { return {body.joints, body.given.tree.joints}; }

    void lay_out(Arena &arena, SpatialAt &at, Index instants) const { lay_out_in_space(arena, at, body, instants); }

    // The motion at so many instants s (8 ..), as far as the rows need it; the attitude at the last one may be given.
    void follow(const double *s, Index instants, SpatialAt &at, const double *last = nullptr) const {
        const Index n = body.joints;
        Motion &m = at.motion;
        m.instants = instants;
        m.per_second = 1 / series->duration;
        for (Index k = 0; k < instants; k += LANES) {
            const Vector here = load(s + k);
            chebyshev_sums(series->p, series->terms, n, here, m.stride, m.sine + k);
            chebyshev_sums(series->p_rate, series->terms, n, here, m.stride, m.p_rate + k);
            if (constraints.needs_accelerations)
                chebyshev_sums(series->p_curvature, series->terms, n, here, m.stride, m.p_curvature + k);
        }
        swing_joints(n, m, series->centre, series->amplitude);
        if (!body.given.needs_rates) return;
        move_tree(body, at, constraints.needs_moments);
        for (Index k = 0; k < instants; ++k) {
            double attitude[9];
            if (last && s[k] == 1) copy(attitude, last, 9);
            else store(attitude, turned->at(*rule, s[k]));
            for (Index e = 0; e < 9; ++e) at.attitude[e * at.stride + k] = attitude[e];
        }
        for (Index k = instants; k % LANES; ++k)
            for (Index e = 0; e < 9; ++e) at.attitude[e * at.stride + k] = at.attitude[e * at.stride + instants - 1];
        for (Index k = 0; k < instants; k += LANES) {
            find_rates(body, at, k, everywhere(turned->cells.momentum));
            if (constraints.needs_moments) drive_tree(body, at, k);
        }
    }

    void values(const SpatialAt &at, Index row, Index from, Index to, double *value) const {
        limit_values(terms(), constraints, at.motion, row, from, to, value);
    }

    void next(const SpatialAt &at, Index row, double *values) const {
        if (constraints.opposite[row] >= 0) return opposite_values(terms(), constraints, at.motion, row, values);
        limit_values(terms(), constraints, at.motion, row, 0, at.motion.instants, values + row * at.stride);
    }
};

class SpatialFlight {
  public:
    using Body = InSpace;
    using Rows = SpatialRows;
    static constexpr Index most_equalities = 3;
    static constexpr bool scales_equalities = true, has_adjoint = false;

    struct State {
        SpatialAt at;        // its motion's planned joints are those of the program's motion
        Turned turned;
        double h_W[3];
        RateSlopes slopes;
        double *turns;                   // (3, size, stride): zeta by x
        bool has_rates, has_turns;       // whether w_B is known at all instants, and these turns
        Index *has_slopes;               // (stride / 8): whether the next are
        double *torque_slopes;           // (tree joints, 3 tree joints + 3, stride)
    };

    const Index joints;

    SpatialFlight(const InSpace &body, const Constraints &constraints, const Motions &motions, const Nodes *levels,
                  const Settings &settings)
        : joints(body.joints), body(body), given(body.given), constraints(constraints), motions(motions),
          levels(levels), settings(settings), tree_joints(given.tree.joints), free(motions.first[joints]) {}

    Index terms() const { return tally().count(); }

    void lay_out(Arena &arena, Index most_nodes, Index most) {
        arena.take(cell, most);
        arena.take(reached, most * Turned::MOST_STAGES);
        arena.take(to_landing, 9 * most_nodes);
        for (double **each : {&drifts, &turns}) arena.take(*each, 3 * motions.size * most);
        arena.take(pack, 8 * 3 * motions.size);
        arena.take(by, 8 * 3 * joints);
        arena.take(by_tree, 8 * 3 * tree_joints);
        room.lay_out(arena, Turned::MOST_STAGES, std::max<Index>(motions.size, 3));
    }

    void lay_out(Arena &arena, Motion &motion, State &state, Index most) const {
        lay_out_in_space(arena, state.at, body, most);
        motion = state.at.motion;
        state.turned.lay_out(arena, most);
        state.slopes.lay_out(arena, joints, most);
        arena.take(state.turns, 3 * motions.size * most);
        arena.take(state.has_slopes, most / 8);
        arena.take(state.torque_slopes, tree_joints * (3 * tree_joints + 3) * most);
    }

    void look_at(Index wanted, const double *s, Index instants, bool) {
        level = wanted;
        stride = instants;
        const Cells &rule = body.cells[level];
        for (Index k = 0; k < stride; ++k) {
            cell[k] = std::min(static_cast<Index>(s[k] * rule.cells), rule.cells - 1);
            chebyshev_sums(rule.antiderivative, rule.stages + 1, rule.stages, s[k] * rule.cells - cell[k], 1,
                           reached + k * rule.stages);
        }
        instant = s;
        for (Index e = 0; e < 9; ++e) combinations[e] = e % 4 == 0;
        combined = 3;
    }

    void choose_momentum(State &state, const double *x) const {
        for (Index a = 0; a < 3; ++a)
            state.h_W[a] = given.momentum[a] + dot(given.axes + a * motions.axes, x + free, motions.axes);
    }

    bool conditions_follow() const { return false; }
    void follow_conditions(const State &, bool, double *) const {}

    void turn_base(Motion &motion, State &state, double *lacking) {
        SpatialAt &at = state.at;
        at.motion = motion;
        at.stride = stride;
        move_tree(body, at, constraints.needs_moments);
        const Index N = levels[level].nodes;
        Turned &turned = state.turned;
        for (Index k = 0; k < N; k += LANES) {
            move_bodies(given.tree, TreeJoints{at, k, nothing(), false}, at.bodies);
            const MomentumMaps maps(at.bodies);
            const Nines inertia = maps.inertia();
            const Threes relative = maps.momentum();
            for (Index lane = 0; lane < LANES; ++lane) {
                store(turned.inertia + 9 * (k + lane), lane_of(inertia, lane));
                store(turned.relative + 3 * (k + lane), lane_of(relative, lane));
            }
        }
        const Cells &rule = body.cells[level];
        Turning &t = turned.cells;
        t.cells = rule.cells;
        t.stages = rule.stages;
        t.integrals = rule.integrals;
        t.weights = rule.weights;
        t.sweeps = given.sweeps;
        t.settled = given.settled;
        t.largest = given.largest;
        t.duration = motions.duration;
        t.momentum = state.h_W;
        t.inertia = turned.inertia;
        t.relative = turned.relative;
        t.is_chained = 1;
        t.columns = 0;
        t.instants = 0;
        copy(t.borders, given.start, 9);
        turned.is_known = turn_cells(t, Asked::attitudes, room);
        if (!turned.is_known) return std::fill(lacking, lacking + 3, HUGE_VAL);
        store(lacking, logarithm(transposed(matrix3(given.goal)) * matrix3(turned.landing())));
    }

    bool is_known(const State &state) const { return state.turned.is_known; }

    // The angle; infinite where the way there has other turns than are wanted, or tilts too far.
    double missed(const State &state, const double *lacking) const {
        if (!is_right_way(state.turned)) return HUGE_VAL;
        return std::sqrt(dot(lacking, lacking, 3));
    }

    void combine(const double *lacking, double *equality) const {
        for (Index e = 0; e < combined; ++e) equality[e] = dot(combinations + 3 * e, lacking, 3);
        for (Index e = combined; e < 3; ++e) equality[e] = 0;
    }

    void combine_rows(const double *lacking, double *rows) const {
        multiply(combinations, combined, 3, lacking, motions.size, rows);
    }

    // Chooses combinations whose derivatives, by steps of a length that is a `scale` of each x's, are orthogonal and of
    // like size: some turns are much harder to make than others. Turns that nothing makes, as those out of the plane of a
    // planar flight, are left out where none is lacking.
    Index scale_equalities(const double *lacking, const double *rows, const double *scale) {
        constexpr double rounding = 1e-7;      // [-] of the largest singular value
        constexpr double most_raised = 100.0;  // [-] by how much the hardest may be scaled up against the easiest
        double squares[9], values[3], vectors[9];
        for (Index a = 0; a < 3; ++a)
            for (Index b = 0; b < 3; ++b) {
                double sum = 0;
                for (Index c = 0; c < motions.size; ++c)
                    sum += scale[c] * scale[c] * rows[a * motions.size + c] * rows[b * motions.size + c];
                squares[3 * a + b] = sum;
            }
        eigenvectors(squares, values, vectors);
        double largest = 0;
        for (double &value : values) largest = larger(largest, value = std::sqrt(larger(value, 0)));
        if (!(largest > 0)) largest = 1;
        combined = 0;
        for (Index a = 0; a < 3; ++a) {
            const double lacks = std::fabs(dot(vectors + 3 * a, lacking, 3));
            if (values[a] <= rounding * largest && lacks <= settings.tolerance) continue;
            const double raised = largest / larger(values[a], largest / most_raised);
            for (Index b = 0; b < 3; ++b) combinations[3 * combined + b] = raised * vectors[3 * a + b];
            ++combined;
        }
        return combined;
    }

    void move_links(Motion &motion, State &state, bool rows, bool sums) {
        state.has_rates = given.needs_rates && (rows || sums);
        if (!state.has_rates) return;
        SpatialAt &at = state.at;
        const Index N = levels[level].nodes;
        const Turning &t = state.turned.cells;
        for (Index k = 0; k < stride; ++k) {
            double attitude[9];
            if (k < N) copy(attitude, t.attitudes + 9 * k, 9);
            else store(attitude, state.turned.at(body.cells[level], instant[k]));
            for (Index e = 0; e < 9; ++e) at.attitude[e * stride + k] = attitude[e];
        }
        at.motion = motion;
        for (Index k = 0; k < stride; k += LANES) {
            find_rates(body, at, k, everywhere(state.h_W));
            if (constraints.needs_moments) drive_tree(body, at, k);
        }
    }

    void differentiate(Motion &, State &state, const Variables &variables, double *rows) {
        SpatialAt &at = state.at;
        const Index N = levels[level].nodes, size = motions.size;
        const Turning &t = state.turned.cells;
        if (!state.has_rates) take_stages(state);
        const Index known = state.has_rates ? stride : N;
        state.slopes.stride = stride;
        for (Index k = 0; k < known; k += LANES) state.slopes.find(body, at, k);
        state.has_turns = false;
        std::fill(state.has_slopes, state.has_slopes + stride / 8, 0);
        // W_j, backwards from the landing on.
        turn_cells(t, Asked::transitions, room);
        Matrix3 onward = transposed(matrix3(given.goal));
        onward = left_jacobian_inverse(logarithm(onward * matrix3(state.turned.landing()))) * onward;
        for (Index c = t.cells; c-- > 0;) {
            for (Index k = c * t.stages; k < (c + 1) * t.stages; ++k)
                store(to_landing + 9 * k, onward * matrix3(t.turn_weights + 9 * k));
            onward = onward * matrix3(t.transitions + 9 * c);
        }
        Vector *slopes = (Vector *)pack, *by_joint = (Vector *)by;
        Threes by_h[3] = {nothing(), nothing(), nothing()};
        zero(pack, 8 * 3 * size);
        for (Index k = 0; k < N; k += LANES) {
            const Nines attitude = nines(at.attitude, stride, k), inverse_inertia = nines(at.inverse, stride, k);
            for (Index row = 0; row < 3; ++row) {
                Threes weight;
                for (Index lane = 0; lane < LANES; ++lane)
                    set_lane(weight, lane, to_landing + 9 * (k + lane) + 3 * row);
                const Threes of_rates = weight * attitude;
                state.slopes.weigh(k, of_rates, by_joint);
                chain_joints(variables, at.motion, joints, k, 1, by_joint, (double *)(slopes + row * size), LANES);
                by_h[row] = by_h[row] + attitude * (of_rates * inverse_inertia);
            }
        }
        for (Index row = 0; row < 3; ++row) {
            for (Index c = 0; c < free; ++c) rows[row * size + c] = sum(slopes[row * size + c]);
            const double h[] = {sum(by_h[row].x), sum(by_h[row].y), sum(by_h[row].z)};
            for (Index axis = 0; axis < motions.axes; ++axis) {
                double &slope = rows[row * size + free + axis] = 0;
                for (Index a = 0; a < 3; ++a) slope += h[a] * given.axes[a * motions.axes + axis];
            }
        }
    }

    void write_row(const Motion &, const State &state, Index row, double *values) const {
        rows_of(none).next(state.at, row, values);
    }

    void row_slopes(Motion &, State &state, const Variables &variables, Index row, Index begin, double *slopes) {
        Vector *weights = (Vector *)state.at.motion.weights;
        for (Index k = begin; k < begin + 8; k += LANES) {
            limit_weights(tally(), constraints, state.at.motion, row, k, weights);
            double *to = slopes + k % 8;
            for (Index c = 0; c < motions.size; ++c) store(to + 8 * c, all(0));
            add_sum_slopes(state.at.motion, state, variables, k, weights, to);
        }
    }

    void write_sum(const Motion &, const State &state, Index which, double *values) const {
        sum_values(tally(), constraints, state.at.motion, which, 0, levels[level].nodes, values);
    }

    // Adds the derivatives (size, 8) of a sum of so much of each term at the instants computed at once.
    void add_sum_slopes(Motion &, State &state, const Variables &variables, Index k, const Vector *weights,
                        double *slopes) {
        SpatialAt &at = state.at;
        if (given.needs_rates && state.turned.is_pulled() && !std::exchange(state.has_turns, true))
            carry_all_turns(state, variables);
        Vector *by_joint = (Vector *)by;
        for (Index i = 0; i < 3 * joints; ++i) by_joint[i] = all(0);
        if (given.needs_rates) {
            const Threes w_B = threes(at.rates, stride, k);
            const Vector length = larger(load(at.motion.rate + k), all(1e-300));
            Threes of_rates = (weights[1] / length) * w_B;
            const Threes by_torques = by_all_torques(state, k, weights + 2 + 2 * joints);
            of_rates = of_rates + by_torques;
            state.slopes.weigh(k, of_rates, by_joint);
            gather_tree(by_joint);
            add_by_base(state, k, of_rates, slopes);
        }
        for (Index i = 0; i < joints; ++i) {
            by_joint[joints + i] += weights[2 + i];
            by_joint[2 * joints + i] += weights[2 + joints + i];
        }
        chain_joints(variables, at.motion, joints, k, constraints.needs_accelerations ? 2 : 1, by_joint, slopes, 8);
    }

    // Root of the relative error of the attitude, as the tail of the rates' Legendre coefficients foretells it: rates that
    // fall as x^j with the degree j in a cell of S stages leave an error of x^(2 S).
    double unresolved(const Motion &, const State &state) const {
        if (!state.turned.is_known) return HUGE_VAL;
        const Cells &rule = body.cells[level];
        const double *rates = state.turned.cells.rates;
        double tail = 0;
        for (Index c = 0; c < rule.cells; ++c)
            for (Index degree = 0; degree < 2; ++degree)
                for (Index a = 0; a < 3; ++a) {
                    double coefficient = 0;
                    for (Index k = 0; k < rule.stages; ++k)
                        coefficient += rule.tail[degree * rule.stages + k] * rates[3 * (c * rule.stages + k) + a];
                    tail = larger(tail, std::fabs(coefficient));
                }
        const double relative = tail / larger(fastest(state), given.slowest / motions.duration);
        return std::pow(relative, static_cast<double>(rule.stages) / (rule.stages - 2));
    }

    // Level at which the attitude at landing is exact to an error: half the length of a cell halves x.
    Index level_needed(const Motion &motion, const State &state, double error) const {
        const double left = unresolved(motion, state);
        const Index finest = settings.levels - 1;
        if (!(left < 1)) return finest;
        const Cells &own = body.cells[level];
        const double decay = std::pow(larger(left, 1e-16), 1.0 / own.stages);
        const double angle = larger(fastest(state) * motions.duration, error);
        for (Index candidate = 0; candidate < finest; ++candidate) {
            const Cells &rule = body.cells[candidate];
            if (angle * std::pow(decay * own.cells / rule.cells, 2 * rule.stages) < error) return candidate;
        }
        return finest;
    }

    SpatialRows rows_of(const Series &series) const { return {body, constraints, &series, nullptr, nullptr}; }

    SpatialRows rows_between(const Motion &, const State &state, Series &series) const {
        return {body, constraints, &series, &state.turned, body.cells + level};
    }

    // Whether rows hold at takeoff and landing that x does not change there.
    Chance chance(const SpatialRows &rows, const Attempt &attempt, SpatialAt &close) const {
        const double ends[LANES] = {0, 1};
        rows.follow(ends, LANES, close, given.goal);
        Chance found{true, true, true};
        for (Index row = 0; row < constraints.rows; ++row) {
            double value[LANES];
            rows.values(close, row, 0, LANES, value);
            copy(attempt.end_values + 2 * row, value, 2);
            for (Index end = 0; end < 2 && !attempt.at_ends[row]; ++end)
                if (end >= attempt.low[row] && end <= attempt.high[row])
                    found.ends_hold &= !(value[end] < -attempt.tolerance[row]);
        }
        return found;
    }

    double longest_way(const Motion &) const { return 0; }  // there are no obstacles in space

  private:
    const InSpace &body;
    const SpatialBody &given;
    const Constraints &constraints;
    const Motions &motions;
    const Nodes *levels;
    const Settings &settings;
    const Index tree_joints, free;
    const Series none{};
    Index level = -1, stride = 0, combined = 3, *cell;
    const double *instant;
    double combinations[9];  // (combined, 3) of what is lacking
    double *reached, *to_landing, *drifts, *turns, *pack, *by, *by_tree;  // the last two several instants at once
    TurningRoom room;

    Terms tally() const { return {joints, tree_joints}; }

    double fastest(const State &state) const {
        double most = 0;
        for (Index e = 0; e < 3 * levels[level].nodes; ++e) most = larger(most, std::fabs(state.turned.cells.rates[e]));
        return most;
    }

    bool is_right_way(const Turned &turned) const {
        TurnsMade way(given);
        way.take(given.start);
        for (Index k = 0; k < levels[level].nodes; ++k) way.take(turned.cells.attitudes + 9 * k);
        way.take(turned.landing());
        return way.is_right();
    }

    // Rates, attitudes and inverse inertias at the nodes, as they are integrated.
    void take_stages(State &state) const {
        const Turning &t = state.turned.cells;
        for (Index k = 0; k < levels[level].nodes; ++k) {
            for (Index e = 0; e < 3; ++e) state.at.rates[e * stride + k] = t.rates[3 * k + e];
            for (Index e = 0; e < 9; ++e) {
                state.at.inverse[e * stride + k] = t.inverse[9 * k + e];
                state.at.attitude[e * stride + k] = t.attitudes[9 * k + e];
            }
        }
    }

    // By planned joints i, what something changes by with the tree's joints, added.
    void gather(const Vector *of_tree, Vector *of_joints) const {
        for (Index j = 0; j < tree_joints; ++j)
            for (Index e = given.first[j]; e < given.first[j + 1]; ++e)
                of_joints[given.planned[e]] = add_product(given.ratio[e], of_tree[j], of_joints[given.planned[e]]);
    }

    // Weights of w_B that weights of the torques (tree joints) are; what they are of the tree's joints is then in by_tree.
    Threes by_all_torques(State &state, Index k, const Vector *weights) {
        Vector *of_tree = (Vector *)by_tree;
        const Index columns = 3 * tree_joints + 3;
        Threes of_rates = nothing();
        for (Index c = 0; c < 3 * tree_joints; ++c) of_tree[c] = all(0);
        bool has_weights = false;
        for (Index j = 0; constraints.needs_moments && j < tree_joints; ++j) has_weights |= any(weights[j] != all(0));
        if (!has_weights) return of_rates;
        const Index entries = tree_joints * columns;
        if (!state.has_slopes[k / 8]) {
            const Index begin = k / 8 * 8;
            for (Index from = begin; from < begin + 8; from += LANES) {
                drive_tree(body, state.at, from);
                torque_slopes(given.tree, state.at.bodies);
                for (Index e = 0; e < entries; ++e)
                    store(state.torque_slopes + e * stride + from, state.at.bodies.slopes[e]);
            }
            state.has_slopes[k / 8] = 1;
        }
        for (Index j = 0; j < tree_joints; ++j) {
            if (!any(weights[j] != all(0))) continue;
            const double *own = state.torque_slopes + j * columns * stride + k;
            for (Index c = 0; c < 3 * tree_joints; ++c)
                of_tree[c] = multiply_add(weights[j], load(own + c * stride), of_tree[c]);
            of_rates = of_rates + weights[j] * threes(own - k + 3 * tree_joints * stride, stride, k);
        }
        return of_rates;
    }

    void gather_tree(Vector *by_joint) const {
        const Vector *of_tree = (const Vector *)by_tree;
        for (Index order = 0; order < 3; ++order) gather(of_tree + order * tree_joints, by_joint + order * joints);
    }

    // Adds what weights of w_B make of h, and of the turns of the base that x makes.
    void add_by_base(const State &state, Index k, Threes of_rates, double *slopes) {
        const SpatialAt &at = state.at;
        const Threes by_h = nines(at.attitude, stride, k) * (of_rates * nines(at.inverse, stride, k));
        for (Index axis = 0; axis < motions.axes; ++axis) {
            const double along[] = {given.axes[axis], given.axes[motions.axes + axis], given.axes[2 * motions.axes + axis]};
            double *slope = slopes + 8 * (free + axis);
            store(slope, load(slope) + dot(by_h, everywhere(along)));
        }
        if (!state.turned.is_pulled()) return;
        const Threes by_turn = cross(by_h, everywhere(state.h_W));  // w^T [h]x
        for (Index c = 0; c < motions.size; ++c) {
            double *slope = slopes + 8 * c;
            const Threes turned = threes(state.turns + c * stride, motions.size * stride, k);
            store(slope, load(slope) + dot(by_turn, turned));
        }
    }

    // zeta by all x, at all instants.
    void carry_all_turns(State &state, const Variables &variables) {
        const SpatialAt &at = state.at;
        const Index N = levels[level].nodes, size = motions.size;
        Vector *by_joint = (Vector *)by, *slopes = (Vector *)pack;
        for (Index k = 0; k < N; k += LANES) {
            const Nines attitude = nines(at.attitude, stride, k), inverse_inertia = nines(at.inverse, stride, k);
            zero(pack, 8 * 3 * size);
            for (Index d = 0; d < 3; ++d) {
                const Threes of_rates = attitude.row[d];
                state.slopes.weigh(k, of_rates, by_joint);
                chain_joints(variables, at.motion, joints, k, 1, by_joint, (double *)(slopes + d * size), LANES);
                const Threes by_h = attitude * (of_rates * inverse_inertia);
                for (Index axis = 0; axis < motions.axes; ++axis) {
                    const double along[] = {given.axes[axis], given.axes[motions.axes + axis],
                                            given.axes[2 * motions.axes + axis]};
                    slopes[d * size + free + axis] = dot(by_h, everywhere(along));
                }
            }
            for (Index c = 0; c < 3 * size; ++c)
                for (Index lane = 0; lane < LANES; ++lane) drifts[(k + lane) * 3 * size + c] = slopes[c][lane];
        }
        Turning t = state.turned.cells;
        t.columns = size;
        t.instants = stride;
        t.cell = cell;
        t.reached = reached;
        t.drifts = drifts;
        t.turns = turns;
        turn_cells(t, Asked::turns, room);
        for (Index k = 0; k < stride; ++k)
            for (Index c = 0; c < 3 * size; ++c) state.turns[c * stride + k] = turns[k * 3 * size + c];
    }
};
