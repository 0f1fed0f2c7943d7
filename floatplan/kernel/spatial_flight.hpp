// A flight in space, as Program<Flight> takes it; see planar_flight.hpp for what that is.
//
// The base turns at w_B of (S1) in spatial_motion.hpp, and R_WB' = R_WB [w_B]x, which turning.hpp integrates in the cells of
// a level. What the attitude at landing lacks is the vector of rotation log(R_goal^T R_WB(T)). By small turns zeta of the
// world's axes, dR = [zeta]x R,
//
//     zeta' = R I^-1 R^T [h]x zeta + g,    g = -R I^-1 (L dq + A dq') + R I^-1 R^T dh.                                (S2)
//
// The turn at landing is sum_j W_j g_j over the stages, with W_j that go backwards through the cells. Where rows or sums
// depend on w_B, by h, the turns at all instants are carried forwards instead, and so for places: a point of body i at x_B, by
// the base's axes and origin, whose place in the world is x_W = c_W + R_WB (x_B - c_B) with c the centre of mass, moves by
//
//     dx_W = zeta x (x_W - c_W) + R_WB sum_j (S_j x_B - dc_B/dq_j) dq_j,    S_j of the joints j that carry i.            (S4)
//
// A distance changes by that of its nearest points along its direction; between two links nothing but the joints counts.

// Rows at any instants of a flight in space.
struct SpatialRowValues {
    using At = SpatialAt;
    const InSpace &body;
    const Constraints &constraints;
    const Series *series;
    const Turned *turned;
    const Cells *rule;

    Index count() const { return constraints.rows; }
    Terms terms() const { return {body.joints, body.spatial_body.tree.joints}; }

    void lay_out(Arena &arena, SpatialAt &at, Index instants) const {
        lay_out_in_space(arena, at, body, constraints.capsules, instants);
    }

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
            store(m.time + k, here * all(series->duration));
        }
        swing_joints(n, m, series->centre, series->amplitude);
        if (!body.spatial_body.needs_rates) return;
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
            find_rates(body, at, k, everywhere<Threes>(turned->cells.momentum));
            if (constraints.needs_places) place_capsules(constraints, at, k);
            if (constraints.needs_moments) drive_tree(body, at, k);
        }
    }

    void values(const SpatialAt &at, Index row, Index from, Index to, double *value) const {
        row_values<Threes>(terms(), constraints, at.motion, row, from, to, value);
    }

    void next(const SpatialAt &at, Index row, double *values) const {
        next_values<Threes>(terms(), constraints, at.motion, row, values);
    }
};

class SpatialFlightEvaluator {
  public:
    using Body = InSpace;
    using Rows = SpatialRowValues;
    static constexpr Index most_equalities = 3;
    static constexpr bool scales_equalities = true, has_adjoint = false;

    struct State {
        SpatialAt at;        // its motion's planned joints are those of the program's motion
        Turned turned;
        double h_W[3];
        RateSlopes slopes;
        double *turns;                   // (3, size, stride): zeta by x
        bool has_rates, has_turns;       // whether w_B is known at all instants, and these turns
        Moves moves;
        Index *has_slopes;               // (stride / 8): whether the next are
        double *torque_slopes;           // (tree joints, 3 tree joints + 3, stride)
    };

    const Index joints;

    SpatialFlightEvaluator(const InSpace &body, const Constraints &constraints, const Motions &motions, const Nodes *levels,
                  const Settings &settings)
        : joints(body.joints), body(body), spatial_body(body.spatial_body), constraints(constraints), motions(motions),
          levels(levels), settings(settings), tree_joints(spatial_body.tree.joints), free(motions.first[joints]) {}

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
        lay_out_in_space(arena, state.at, body, constraints.capsules, most);
        motion = state.at.motion;
        state.turned.lay_out(arena, most);
        state.slopes.lay_out(arena, joints, most);
        state.moves.lay_out(arena, constraints.capsules ? tree_joints : 0, most);
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
            state.h_W[a] = spatial_body.momentum[a] + dot(spatial_body.axes + a * motions.axes, x + free, motions.axes);
    }

    bool conditions_follow() const { return false; }
    void follow_conditions(const State &, bool, double *) const {}

    void turn_base(Motion &motion, State &state, double *lacking) {
        state.at.motion = motion;
        state.at.stride = stride;
        move_tree(body, state.at, constraints.needs_moments);
        find_momentum_maps(state);
        describe_cells(state);
        Turned &turned = state.turned;
        turned.is_known = turn_cells(turned.cells, Asked::attitudes, room);
        if (!turned.is_known) return std::fill(lacking, lacking + 3, HUGE_VAL);
        store(lacking, logarithm(transposed(matrix3(spatial_body.goal)) * matrix3(turned.landing())));
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
        state.has_rates = spatial_body.needs_rates && (rows || sums);
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
            find_rates(body, at, k, everywhere<Threes>(state.h_W));
            if (constraints.needs_places) place_capsules(constraints, at, k);
            if (constraints.needs_moments) drive_tree(body, at, k);
        }
    }

    void differentiate(Motion &, State &state, const Variables &variables, double *rows) {
        if (!state.has_rates) take_stages(state);
        const Index known = state.has_rates ? stride : levels[level].nodes;
        state.slopes.stride = stride;
        for (Index k = 0; k < known; k += LANES) state.slopes.find(body, state.at, k);
        state.has_turns = false;
        std::fill(state.has_slopes, state.has_slopes + stride / 8, 0);
        state.moves.forget(stride);
        weigh_turns_by_landing(state);
        differentiate_landing(state, variables, rows);
    }

    void write_row(const Motion &, const State &state, Index row, double *values) const {
        rows_of(none).next(state.at, row, values);
    }

    void row_slopes(Motion &, State &state, const Variables &variables, Index row, Index begin, double *slopes) {
        Vector *weights = (Vector *)state.at.motion.weights;
        for (Index k = begin; k < begin + 8; k += LANES) {
            double *to = slopes + k % 8;
            for (Index c = 0; c < motions.size; ++c) store(to + 8 * c, all(0));
            if (constraints.kind[row] > share_row) {
                add_distance_slopes(state, variables, row, k, to);
                continue;
            }
            limit_weights(tally(), constraints, state.at.motion, row, k, weights);
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
        if (spatial_body.needs_rates && state.turned.is_pulled() && !std::exchange(state.has_turns, true))
            carry_all_turns(state, variables);
        Vector *by_joint = (Vector *)by;
        for (Index i = 0; i < 3 * joints; ++i) by_joint[i] = all(0);
        if (spatial_body.needs_rates) {
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
        const double relative = tail / larger(fastest(state), spatial_body.slowest / motions.duration);
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

    SpatialRowValues rows_of(const Series &series) const { return {body, constraints, &series, nullptr, nullptr}; }

    SpatialRowValues rows_between(const Motion &, const State &state, Series &series) const {
        return {body, constraints, &series, &state.turned, body.cells + level};
    }

    // Whether rows hold at takeoff and landing that x does not change there.
    Chance chance(const SpatialRowValues &rows, const SearchProblem &problem, SpatialAt &close) const {
        const double ends[LANES] = {0, 1};
        rows.follow(ends, LANES, close, spatial_body.goal);
        Chance found{true, true, true};
        for (Index row = 0; row < constraints.rows; ++row) {
            double value[LANES];
            rows.values(close, row, 0, LANES, value);
            copy(problem.end_values + 2 * row, value, 2);
            for (Index end = 0; end < 2 && !problem.at_ends[row]; ++end)
                if (end >= problem.low[row] && end <= problem.high[row])
                    found.ends_hold &= !(value[end] < -problem.tolerance[row]);
        }
        return found;
    }

    double longest_way(const State &state, const Motion &) const {
        if (!state.turned.is_known) return 0;
        return longest_way_of_ends<Threes>(constraints, state.at.motion, levels[level].nodes);
    }

  private:
    const InSpace &body;
    const SpatialBody &spatial_body;
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
    TurningWorkspace room;

    Terms tally() const { return {joints, tree_joints}; }

    double fastest(const State &state) const {
        double most = 0;
        for (Index e = 0; e < 3 * levels[level].nodes; ++e) most = larger(most, std::fabs(state.turned.cells.rates[e]));
        return most;
    }

    bool is_right_way(const Turned &turned) const {
        TurnsMade way(spatial_body);
        way.take(spatial_body.start);
        for (Index k = 0; k < levels[level].nodes; ++k) way.take(turned.cells.attitudes + 9 * k);
        way.take(turned.landing());
        return way.is_right();
    }

    // I and A q' of (S1) at the nodes.
    void find_momentum_maps(State &state) const {
        SpatialAt &at = state.at;
        for (Index k = 0; k < levels[level].nodes; k += LANES) {
            move_bodies(spatial_body.tree, TreeJoints{at, k, nothing(), false}, at.bodies);
            const MomentumMaps maps(at.bodies);
            const Nines inertia = maps.inertia();
            const Threes relative = maps.momentum();
            for (Index lane = 0; lane < LANES; ++lane) {
                store(state.turned.inertia + 9 * (k + lane), lane_of(inertia, lane));
                store(state.turned.relative + 3 * (k + lane), lane_of(relative, lane));
            }
        }
    }

    // What turning.hpp integrates: one cell after the other, from the attitude at takeoff on.
    void describe_cells(State &state) const {
        const Cells &rule = body.cells[level];
        Turning &cells = state.turned.cells;
        cells.cells = rule.cells;
        set_rule(cells, rule, spatial_body);
        cells.duration = motions.duration;
        cells.momentum = state.h_W;
        cells.inertia = state.turned.inertia;
        cells.relative = state.turned.relative;
        cells.is_chained = 1;
        cells.columns = 0;
        cells.instants = 0;
        copy(cells.borders, spatial_body.start, 9);
    }

    // W_j in to_landing (nodes, 3, 3): what a turn that begins at a node changes of what is lacking at landing, by the
    // derivative of the logarithm, and from there backwards through the cells.
    void weigh_turns_by_landing(State &state) {
        const Turning &cells = state.turned.cells;
        turn_cells(cells, Asked::transitions, room);
        const Matrix3 to_goal = transposed(matrix3(spatial_body.goal));
        const Vector3 lacking = logarithm(to_goal * matrix3(state.turned.landing()));
        Matrix3 onward = left_jacobian_inverse(lacking) * to_goal;
        for (Index c = cells.cells; c-- > 0;) {
            for (Index k = c * cells.stages; k < (c + 1) * cells.stages; ++k)
                store(to_landing + 9 * k, onward * matrix3(cells.turn_weights + 9 * k));
            onward = onward * matrix3(cells.transitions + 9 * c);
        }
    }

    // Derivatives (3, size) of what is lacking, sum_j W_j g_j, by x: those of the joints through w_B, and those of h.
    void differentiate_landing(State &state, const Variables &variables, double *rows) {
        const SpatialAt &at = state.at;
        const Index size = motions.size;
        Vector *slopes = (Vector *)pack, *by_joint = (Vector *)by;
        Threes by_h[3] = {nothing(), nothing(), nothing()};
        zero(pack, 8 * 3 * size);
        for (Index k = 0; k < levels[level].nodes; k += LANES) {
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
                double &slope = rows[row * size + free + axis];
                slope = 0;
                for (Index a = 0; a < 3; ++a) slope += h[a] * spatial_body.axes[a * motions.axes + axis];
            }
        }
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
            for (Index e = spatial_body.first[j]; e < spatial_body.first[j + 1]; ++e)
                of_joints[spatial_body.planned[e]] =
                    add_product(spatial_body.ratio[e], of_tree[j], of_joints[spatial_body.planned[e]]);
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
                torque_slopes(spatial_body.tree, state.at.bodies);
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
            const double along[] = {spatial_body.axes[axis], spatial_body.axes[motions.axes + axis],
                                    spatial_body.axes[2 * motions.axes + axis]};
            double *slope = slopes + 8 * (free + axis);
            store(slope, load(slope) + dot(by_h, everywhere<Threes>(along)));
        }
        if (!state.turned.is_pulled()) return;
        const Threes by_turn = cross(by_h, everywhere<Threes>(state.h_W));  // w^T [h]x
        for (Index c = 0; c < motions.size; ++c) {
            double *slope = slopes + 8 * c;
            const Threes turned = threes(state.turns + c * stride, motions.size * stride, k);
            store(slope, load(slope) + dot(by_turn, turned));
        }
    }

    // Adds the derivatives (size, 8) of a row of distances at the instants computed at once, by (S4).
    void add_distance_slopes(State &state, const Variables &variables, Index row, Index k, double *slopes) {
        SpatialAt &at = state.at;
        const bool is_pair = constraints.kind[row] == pair_row;
        if (!is_pair && !std::exchange(state.has_turns, true)) carry_all_turns(state, variables);
        state.moves.find(body, at, k);
        const Nearest<Threes> found = nearest<Threes>(constraints, at.motion, row, k);
        const Nines R_WB = nines(at.attitude, stride, k);
        const Threes com_W = com_at(constraints, at, k), com_B = threes(state.moves.com, stride, k);
        Vector *of_tree = (Vector *)by_tree, *by_joint = (Vector *)by;
        for (Index j = 0; j < tree_joints; ++j) of_tree[j] = all(0);
        for (Index i = 0; i < joints; ++i) by_joint[i] = all(0);
        // A point of a capsule, a share along it, from the centre of mass; what it moves along a vector is added.
        const auto add_capsule = [&](Index capsule, Vector share, Threes along_W) {
            const Threes start = end_of<Threes>(at.motion, 2 * capsule, k);
            const Threes stop = end_of<Threes>(at.motion, 2 * capsule + 1, k);
            const Threes from_com = start + share * (stop - start) - com_W;
            state.moves.weigh(spatial_body.tree, constraints.body[capsule], com_B + from_com * R_WB, along_W * R_WB, k, of_tree);
            return from_com;
        };
        const Threes along_W = all(constraints.per_scale[row]) * found.direction;
        const Threes from_com = add_capsule(constraints.first[row], found.own, along_W);
        if (is_pair) add_capsule(constraints.second[row], found.other, -along_W);
        else state.moves.weigh_com(spatial_body.tree, -(along_W * R_WB), k, of_tree);
        gather(of_tree, by_joint);
        chain_joints(variables, at.motion, joints, k, 0, by_joint, slopes, 8);
        if (is_pair) return;
        const Threes by_turn = cross(from_com, along_W);
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
                    const double along[] = {spatial_body.axes[axis], spatial_body.axes[motions.axes + axis],
                                            spatial_body.axes[2 * motions.axes + axis]};
                    slopes[d * size + free + axis] = dot(by_h, everywhere<Threes>(along));
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
