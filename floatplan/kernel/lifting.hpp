// A lifted motion (multiple shooting): cells that each begin with an attitude of their own, see
// floatplan/planning/lifting.py. All cells are integrated at once, as turning.hpp does one after the other: a vector holds
// one number of as many cells. What that cannot integrate well is left to turning.hpp.

// As Turning, of the cells from one on that are computed at once; arrays (.., stages, cells), stage by stage.
class CellsAtOnce {
  public:
    CellsAtOnce(const Cells &rule, double duration, const double *h_W)
        : rule(rule), S(rule.stages), step(duration / rule.cells), h_W(h_W) {}

    void lay_out(Arena &arena) {
        arena.take(matrix, 16 * S * S);
        arena.take(right, 9 * S + 4 * S);
        arena.take(swung, S);
        arena.take(seen, S);
        arena.take(mu, S);
        for (Quaternion **each : {&still, &carried}) arena.take(*each, S);
        for (Nines **each : {&inverse_inertia, &attitude, &weight}) arena.take(*each, S);
        for (Threes **each : {&relative, &w_B}) arena.take(*each, S);
    }

    struct Quaternion {
        Threes along;
        Vector w;
    };

    Nines *inverse_inertia, *attitude, *weight;  // (S): I^-1 is given; R_WB; W_j of the turn at the cell's end
    Threes *relative, *w_B;                      // (S): A q' is given
    Quaternion *still, *carried;                 // (S): rates of the quaternions that make an attitude
    Nines end, transition;

    // Whether all is well: R_WB from a border on, w_B, and how small turns go on.
    bool integrate(const Nines &border) {
        const bool carries = h_W[0] != 0 || h_W[1] != 0 || h_W[2] != 0;
        const Threes h = everywhere<Threes>(h_W);
        Nines last_swung, last_carried = multiple(all(1));
        for (Index k = 0; k < S; ++k) w_B[k] = -(inverse_inertia[k] * relative[k]);
        if (!spin([&](Index k) { return w_B[k]; }, still, last_swung)) return false;
        for (Index k = 0; k < S; ++k) {
            swung[k] = spun(still, k);
            seen[k] = swung[k] * inverse_inertia[k] * transposed(swung[k]);
        }
        if (carries) {
            if (!carry_momentum(h * border)) return false;
            if (!spin([&](Index k) { return seen[k] * mu[k]; }, carried, last_carried)) return false;
        }
        for (Index k = 0; k < S; ++k) {
            if (carries) w_B[k] = w_B[k] + (seen[k] * mu[k]) * swung[k];
            attitude[k] = border * (carries ? spun(carried, k) * swung[k] : swung[k]);
        }
        end = border * last_carried * last_swung;
        return carry_turns();
    }

  private:
    const Cells &rule;
    const Index S;
    const double step, *h_W;
    Vector *matrix, *right;
    Nines *swung, *seen;
    Threes *mu;

    // Solves M X = B without exchanges of rows; whether no pivot is small.
    static bool eliminate(Vector *matrix, Vector *right, Index n, Index columns) {
        constexpr double small = 0.1;  // [-] of 1, which all pivots are for a cell of no length
        Bits is_well = Bits{} - 1;
        for (Index k = 0; k < n; ++k) {
            const Vector *above = matrix + k * n;
            is_well &= magnitude(above[k]) > all(small);
            const Vector per_pivot = all(1) / above[k];
            for (Index i = k + 1; i < n; ++i) {
                const Vector factor = -matrix[i * n + k] * per_pivot;
                for (Index j = k + 1; j < n; ++j) matrix[i * n + j] = multiply_add(factor, above[j], matrix[i * n + j]);
                for (Index c = 0; c < columns; ++c)
                    right[i * columns + c] = multiply_add(factor, right[k * columns + c], right[i * columns + c]);
            }
        }
        for (Index i = n; i-- > 0;)
            for (Index c = 0; c < columns; ++c) {
                Vector value = right[i * columns + c];
                for (Index j = i + 1; j < n; ++j) value = multiply_add(-matrix[i * n + j], right[j * columns + c], value);
                right[i * columns + c] = value / matrix[i * n + i];
            }
        return !any(~is_well);
    }

    // 1 - step A_jk block_k, of blocks (size, size).
    template <typename Block> void collocate(Index size, Block block) {
        const Index n = size * S;
        Vector of[16];
        for (Index k = 0; k < S; ++k) {
            block(k, of);
            for (Index j = 0; j < S; ++j) {
                const Vector factor = all(-step * rule.integrals[j * S + k]);
                for (Index a = 0; a < size; ++a)
                    for (Index b = 0; b < size; ++b)
                        matrix[(size * j + a) * n + size * k + b] = factor * of[size * a + b] + all(j == k && a == b);
            }
        }
    }

    static void place(const Nines &block, Vector *of) {
        for (Index a = 0; a < 3; ++a) {
            of[3 * a] = block.row[a].x;
            of[3 * a + 1] = block.row[a].y;
            of[3 * a + 2] = block.row[a].z;
        }
    }

    template <typename Rate> bool spin(Rate rate, Quaternion *rates, Nines &last) {
        const auto block = [&](Index k, Vector *of) {
            const Threes w = all(0.5) * rate(k);
            const Vector none = all(0), filled[] = {none, w.z,  -w.y, w.x, -w.z, none, w.x,  w.y,
                                                    w.y,  -w.x, none, w.z, -w.x, -w.y, -w.z, none};
            for (Index e = 0; e < 16; ++e) of[e] = filled[e];
        };
        collocate(4, block);
        for (Index i = 0; i < 4 * S; ++i) right[i] = all(i % 4 == 3);
        if (!eliminate(matrix, right, 4 * S, 1)) return false;
        Quaternion ended = {nothing(), all(1)};
        for (Index k = 0; k < S; ++k) {
            const Threes w = all(0.5) * rate(k), along = {right[4 * k], right[4 * k + 1], right[4 * k + 2]};
            rates[k] = {right[4 * k + 3] * w + cross(along, w), -dot(w, along)};
            const Vector factor = all(step * rule.weights[k]);
            ended = {ended.along + factor * rates[k].along, ended.w + factor * rates[k].w};
        }
        last = rotation(ended.along, ended.w);
        return true;
    }

    Nines spun(const Quaternion *rates, Index stage) const {
        Quaternion at = {nothing(), all(1)};
        for (Index k = 0; k < S; ++k) {
            const Vector factor = all(step * rule.integrals[stage * S + k]);
            at = {at.along + factor * rates[k].along, at.w + factor * rates[k].w};
        }
        return rotation(at.along, at.w);
    }

    // Newton's method for mu' = mu x (J mu), where it ends in the usual number of sweeps.
    bool carry_momentum(Threes start) {
        constexpr Index sweeps = 6;
        constexpr double settled = 1e-13;  // [-] of |h|: a step below which Newton's method has ended
        const Vector size = square_root(dot(start, start));
        for (Index k = 0; k < S; ++k) mu[k] = start;
        for (Index sweep = 0; sweep < sweeps; ++sweep) {
            Threes *off = (Threes *)right;
            for (Index j = 0; j < S; ++j) off[j] = start - mu[j];
            collocate(3, [&](Index k, Vector *of) {
                const Threes turning = seen[k] * mu[k], growth = cross(mu[k], turning);
                for (Index j = 0; j < S; ++j) off[j] = off[j] + all(step * rule.integrals[j * S + k]) * growth;
                place(cross_matrix(mu[k]) * seen[k] - cross_matrix(turning), of);
            });
            if (!eliminate(matrix, right, 3 * S, 1)) return false;
            Bits is_done = Bits{} - 1;
            for (Index k = 0; k < S; ++k) {
                mu[k] = mu[k] + off[k];
                is_done &= square_root(dot(off[k], off[k])) < all(settled) * size;
            }
            if (!any(~is_done)) return true;
        }
        return false;
    }

    // W_j and the transition, of transposed equations as in turning.hpp.
    bool carry_turns() {
        const Index n = 3 * S;
        const Nines across = cross_matrix(everywhere<Threes>(h_W));
        for (Index k = 0; k < S; ++k) weight[k] = attitude[k] * inverse_inertia[k] * transposed(attitude[k]) * across;
        collocate(3, [&](Index k, Vector *of) { place(weight[k], of); });
        for (Index i = 0; i < n; ++i)
            for (Index j = 0; j < i; ++j) std::swap(matrix[i * n + j], matrix[j * n + i]);
        for (Index k = 0; k < S; ++k) place(all(rule.weights[k]) * transposed(weight[k]), right + 9 * k);
        if (!eliminate(matrix, right, n, 3)) return false;
        transition = multiple(all(1));
        auto through = [&](Index k) {
            const Vector *of = right + 9 * k;
            return transposed(Nines{{{of[0], of[1], of[2]}, {of[3], of[4], of[5]}, {of[6], of[7], of[8]}}});
        };
        for (Index k = 0; k < S; ++k) {
            weight[k] = multiple(all(step * rule.weights[k]));
            for (Index j = 0; j < S; ++j) weight[k] = weight[k] + all(step * step * rule.integrals[j * S + k]) * through(j);
            transition = transition + all(step) * through(k);
        }
        return true;
    }
};

class LiftedMotion {
  public:
    LiftedMotion(const InSpace &body, const Motions &motions, const Nodes &nodes, Lifted &of)
        : body(body), spatial_body(body.spatial_body), motions(motions), nodes(nodes), of(of), rule(*body.cells), C(rule.cells),
          S(rule.stages), K(C * S), n(body.joints), size(motions.size), free(motions.first[n]),
          at_once(rule, motions.duration, h_W) {}

    void lay_out(Arena &arena) {
        lay_out_in_space(arena, at, body, 0, K);
        arena.take(coefficients, motions.columns * n);
        arena.take(basis, 3 * size * K);
        arena.take(relative, 3 * K);
        arena.take(weights, 9 * K);
        arena.take(by, 8 * 3 * n);
        arena.take(pack, 8 * 3 * size);
        arena.take(slopes, C * 3 * size);
        arena.take(transitions, 9 * C);
        rates.lay_out(arena, n, K);
        at_once.lay_out(arena);
        room.lay_out(arena, S, 3);
        for (double **each : {&stage_inertia, &stage_inverse, &stage_attitudes, &stage_weights})
            arena.take(*each, 9 * LANES * S);
        for (double **each : {&stage_relative, &stage_rates}) arena.take(*each, 3 * LANES * S);
        for (double **each : {&stage_still, &stage_carried}) arena.take(*each, 4 * LANES * S);
        for (double **each : {&stage_borders, &stage_ends, &stage_transitions}) arena.take(*each, 9 * LANES);
    }

    // Whether it can be integrated.
    bool evaluate() {
        for (Index a = 0; a < 3; ++a)
            h_W[a] = spatial_body.momentum[a] + dot(spatial_body.axes + a * motions.axes, of.x + free, motions.axes);
        move();
        for (Index first = 0; first < C; first += LANES)
            if (!integrate_cells(first)) return false;
        for (Index c = 0; c < C; ++c) {
            const Matrix3 next = matrix3(c + 1 < C ? of.borders + 9 * (c + 1) : spatial_body.goal);
            store(of.gaps + 3 * c, logarithm(next * transposed(matrix3(of.ends + 9 * c))));
        }
        of.is_right_way = is_right_way();
        differentiate();
        carry();
        return true;
    }

  private:
    const InSpace &body;
    const SpatialBody &spatial_body;
    const Motions &motions;
    const Nodes &nodes;
    Lifted &of;
    const Cells &rule;
    const Index C, S, K, n, size, free;
    double h_W[3];
    SpatialAt at{};
    RateSlopes rates;
    CellsAtOnce at_once;
    TurningWorkspace room;
    double *coefficients, *basis, *relative, *weights;  // weights (9, K) of g, A q' (3, K)
    double *by, *pack, *slopes, *transitions;                      // the last two (C, 3, size), (C, 3, 3)
    double *stage_inertia, *stage_inverse, *stage_attitudes, *stage_weights, *stage_relative, *stage_rates;
    double *stage_still, *stage_carried, *stage_borders, *stage_ends, *stage_transitions;

    // Joints, inertia and momentum at all stages.
    void move() {
        Motion &m = at.motion;
        m.per_second = 1 / motions.duration;
        place_coefficients(motions, n, of.x, motions.boundary, coefficients);
        combine(m, n, coefficients, motions.columns, nodes.value, nodes.first, nodes.second);
        swing_joints(n, m, motions.centre, motions.amplitude);
        move_tree(body, at, false);
        for (Index k = 0; k < K; k += LANES) {
            move_bodies(spatial_body.tree, TreeJoints{at, k, nothing(), false}, at.bodies);
            const MomentumMaps maps(at.bodies);
            store(at.inverse, K, k, inverse(maps.inertia()));
            store(relative, K, k, maps.momentum());
        }
    }

    static Nines gathered(const double *matrices) {  // of as many cells, side by side
        Nines value;
        for (Index lane = 0; lane < LANES; ++lane) set_lane(value, lane, matrices + 9 * lane);
        return value;
    }

    static void scatter(const Nines &value, double *matrices) {
        for (Index lane = 0; lane < LANES; ++lane) store(matrices + 9 * lane, lane_of(value, lane));
    }

    // The cells from one on that are computed at once.
    bool integrate_cells(Index first) {
        for (Index s = 0; s < S; ++s) {
            at_once.inverse_inertia[s] = nines(at.inverse, K, s * C + first);
            at_once.relative[s] = threes(relative, K, s * C + first);
        }
        if (!at_once.integrate(gathered(of.borders + 9 * first)) && !turn_one_by_one(first)) return false;
        for (Index s = 0; s < S; ++s) {
            const Index k = s * C + first;
            store(at.attitude, K, k, at_once.attitude[s]);
            store(at.rates, K, k, at_once.w_B[s]);
            store(weights, K, k, at_once.weight[s]);
            for (Index lane = 0; lane < LANES; ++lane) {
                double *to = of.spun + 4 * ((first + lane) * S + s);
                for (const CellsAtOnce::Quaternion *rates : {at_once.carried + s, at_once.still + s}) {
                    store(to, lane_of(rates->along, lane));
                    to[3] = rates->w[lane];
                    to += 4 * K;
                }
            }
        }
        scatter(at_once.end, of.ends + 9 * first);
        scatter(at_once.transition, transitions + 9 * first);
        return true;
    }

    // The same with exchanges of rows and as many sweeps as are allowed.
    bool turn_one_by_one(Index first) {
        Turning t{};
        t.cells = LANES;
        set_rule(t, rule, spatial_body);
        t.duration = motions.duration / C * LANES;
        t.momentum = h_W;
        t.inertia = stage_inertia;
        t.relative = stage_relative;
        t.borders = stage_borders;
        t.ends = stage_ends;
        t.inverse = stage_inverse;
        t.attitudes = stage_attitudes;
        t.rates = stage_rates;
        t.still_rates = stage_still;
        t.carried_rates = stage_carried;
        t.transitions = stage_transitions;
        t.turn_weights = stage_weights;
        copy(stage_borders, of.borders + 9 * first, 9 * LANES);
        for (Index s = 0; s < S; ++s) {
            const Nines inertia = inverse(at_once.inverse_inertia[s]);
            for (Index lane = 0; lane < LANES; ++lane) {
                store(stage_inertia + 9 * (lane * S + s), lane_of(inertia, lane));
                store(stage_relative + 3 * (lane * S + s), lane_of(at_once.relative[s], lane));
            }
        }
        if (!turn_cells(t, Asked::attitudes, room) || !turn_cells(t, Asked::transitions, room)) return false;
        const bool carries = dot(vector3(h_W), vector3(h_W)) > 0;
        for (Index s = 0; s < S; ++s)
            for (Index lane = 0; lane < LANES; ++lane) {
                const Index from = lane * S + s;
                set_lane(at_once.attitude[s], lane, stage_attitudes + 9 * from);
                set_lane(at_once.weight[s], lane, stage_weights + 9 * from);
                set_lane(at_once.w_B[s], lane, stage_rates + 3 * from);
                set_lane(at_once.still[s].along, lane, stage_still + 4 * from);
                at_once.still[s].w[lane] = stage_still[4 * from + 3];
                if (!carries) continue;
                set_lane(at_once.carried[s].along, lane, stage_carried + 4 * from);
                at_once.carried[s].w[lane] = stage_carried[4 * from + 3];
            }
        at_once.end = gathered(stage_ends);
        at_once.transition = gathered(stage_transitions);
        return true;
    }

    bool is_right_way() {
        TurnsMade way(spatial_body);
        way.take(of.borders);
        for (Index c = 0; spatial_body.angles && c < C; ++c)
            for (Index s = 0; s < S; ++s) {
                double attitude[9];
                for (Index e = 0; e < 9; ++e) attitude[e] = at.attitude[e * K + s * C + c];
                way.take(attitude);
            }
        way.take(of.ends + 9 * (C - 1));
        return way.is_right();
    }

    // Turns (C, 3, size) of the cells' ends by x: sum_j W_j g_j.
    void differentiate() {
        const double *of_columns[3] = {nodes.value, nodes.first, nodes.second};
        combine_basis(motions, n, of_columns, K, basis);
        const Variables variables{size, K, basis, motions.first, nullptr, nullptr};
        Vector *by_joint = (Vector *)by, *sums = (Vector *)pack;
        rates.stride = K;
        for (Index first = 0; first < C; first += LANES) {
            zero(pack, 8 * 3 * size);
            for (Index s = 0; s < S; ++s) {
                const Index k = s * C + first;
                rates.find(body, at, k);
                const Nines attitude = nines(at.attitude, K, k), inverse_inertia = nines(at.inverse, K, k);
                const Nines weight = nines(weights, K, k);
                for (Index row = 0; row < 3; ++row) {
                    const Threes of_rates = weight.row[row] * attitude;
                    rates.weigh(k, of_rates, by_joint);
                    Vector *to = sums + row * size;
                    chain_joints(variables, at.motion, n, k, 1, by_joint, (double *)to, LANES);
                    const Threes by_h = attitude * (of_rates * inverse_inertia);
                    for (Index axis = 0; axis < motions.axes; ++axis) {
                        const double along[] = {spatial_body.axes[axis], spatial_body.axes[motions.axes + axis],
                                                spatial_body.axes[2 * motions.axes + axis]};
                        to[free + axis] += dot(by_h, everywhere<Threes>(along));
                    }
                }
            }
            for (Index lane = 0; lane < LANES; ++lane)
                for (Index c = 0; c < 3 * size; ++c) slopes[(first + lane) * 3 * size + c] = sums[c][lane];
        }
    }

    // How all of that goes on from cell to cell.
    void carry() {
        for (Index c = 0; c < C; ++c) {
            const double *transition = transitions + 9 * c;
            double *turns = of.turns + c * 3 * size, *carried = of.carried + c * 9 * C;
            zero(turns, 3 * size);
            zero(carried, 9 * C);
            if (c) {
                multiply(transition, 3, 3, turns - 3 * size, size, turns);
                multiply(transition, 3, 3, carried - 9 * C, 3 * C, carried);
            }
            add(1, slopes + c * 3 * size, 3 * size, turns);
            for (Index a = 0; a < 3; ++a) carried[3 * C * a + 3 * c + a] = 1;
        }
    }
};

// 0, or 1 where it cannot be integrated, 2 without memory.
Index lift_motion(const SpatialBody &spatial_body, const Cells &cells, const Motions &motions, const Nodes &nodes, Lifted &of) {
    const InSpace body{spatial_body, &cells, spatial_body.joints};
    LiftedMotion lifted(body, motions, nodes, of);
    Workspace room;
    if (!room.make([&](Arena &arena) { lifted.lay_out(arena); })) return 2;
    return lifted.evaluate() ? 0 : 1;
}
