// How a base turns in space: its attitude by Gauss collocation in cells; see floatplan/motion/spatial/attitude.py.

struct TurningWorkspace {
    double *matrix, *right, *mu, *seen, *border, *grown;  // the last two (3, columns)

    void lay_out(Arena &arena, Index stages, Index columns) {
        arena.take(matrix, 16 * stages * stages), arena.take(right, 4 * stages * columns);
        arena.take(mu, 3 * stages), arena.take(seen, 9 * stages);
        arena.take(border, 3 * columns), arena.take(grown, 3 * columns);
    }
};

// Gives cells the stages of a rule, and Newton's method the tolerances of a body.
static inline void set_rule(Turning &t, const Cells &rule, const SpatialBody &body) {
    t.stages = rule.stages;
    t.integrals = rule.integrals;
    t.weights = rule.weights;
    t.sweeps = body.sweeps;
    t.settled = body.settled;
    t.largest = body.largest;
}

// 1 - step A_jk block_k, of blocks (stages, size, size) that are written where they go; A (stages, stages).
template <typename Block>
static inline void collocate(const Turning &t, double step, Index size, double *matrix, Block block) {
    const Index stages = t.stages, n = size * stages;
    double of[16];
    for (Index k = 0; k < stages; ++k) {
        block(k, of);
        for (Index j = 0; j < stages; ++j)
            for (Index a = 0; a < size; ++a)
                for (Index b = 0; b < size; ++b)
                    matrix[(size * j + a) * n + size * k + b] =
                        (j == k && a == b) - step * t.integrals[j * stages + k] * of[size * a + b];
    }
}

// Quaternions' rates (stages, 4) of a rotation from the identity by body rates, and the rotation at the cell's end;
// false where it cannot be integrated. p' = spin p of a quaternion x, y, z, w.
template <typename Rate>
static inline bool spin(const Turning &t, double step, TurningWorkspace &room, Rate rate, double *rates, Matrix3 &end) {
    const auto block = [&](Index k, double *of) {
        const Vector3 w = 0.5 * rate(k);
        const double filled[] = {0, w.z, -w.y, w.x, -w.z, 0, w.x, w.y, w.y, -w.x, 0, w.z, -w.x, -w.y, -w.z, 0};
        copy(of, filled, 16);
    };
    collocate(t, step, 4, room.matrix, block);
    for (Index i = 0; i < 4 * t.stages; ++i) room.right[i] = i % 4 == 3;
    if (!eliminate(room.matrix, room.right, 4 * t.stages)) return false;
    double of[16], ended[] = {0, 0, 0, 1};
    for (Index k = 0; k < t.stages; ++k) {
        block(k, of);
        for (Index a = 0; a < 4; ++a) {
            rates[4 * k + a] = dot(of + 4 * a, room.right + 4 * k, 4);
            ended[a] += step * t.weights[k] * rates[4 * k + a];
        }
    }
    end = rotation(ended);
    return std::isfinite(end.row[0].x);
}

// The rotation at a stage.
static inline Matrix3 spun(const Turning &t, double step, const double *rates, Index stage) {
    double at[] = {0, 0, 0, 1};
    for (Index k = 0; k < t.stages; ++k)
        add(step * t.integrals[stage * t.stages + k], rates + 4 * k, 4, at);
    return rotation(at);
}

// Solves mu' = mu x (J mu), mu (stages, 3) from `start` on, by Newton's method; false where it does not end.
static inline bool carry_momentum(const Turning &t, double step, TurningWorkspace &room, Vector3 start) {
    const Index stages = t.stages;
    const double size = std::sqrt(dot(start, start));
    for (Index k = 0; k < stages; ++k) store(room.mu + 3 * k, start);
    for (Index sweep = 0; sweep < t.sweeps; ++sweep) {
        for (Index j = 0; j < stages; ++j) store(room.right + 3 * j, start - vector3(room.mu + 3 * j));
        collocate(t, step, 3, room.matrix, [&](Index k, double *of) {
            const Vector3 mu = vector3(room.mu + 3 * k), turning = matrix3(room.seen + 9 * k) * mu;
            double growth[3];
            store(growth, cross(mu, turning));
            for (Index j = 0; j < stages; ++j)
                add(step * t.integrals[j * stages + k], growth, 3, room.right + 3 * j);
            store(of, cross_matrix(mu) * matrix3(room.seen + 9 * k) - cross_matrix(turning));
        });
        if (!eliminate(room.matrix, room.right, 3 * stages)) return false;
        double largest = 0;
        for (Index i = 0; i < 3 * stages; ++i) {
            room.mu[i] += room.right[i];
            largest = std::fabs(room.right[i]) <= largest ? largest : std::fabs(room.right[i]);  // NaN is the largest
        }
        if (!(largest < t.largest * size)) return false;
        if (largest < t.settled * size) return true;
    }
    return false;
}

// One cell from the attitude at its border on; false where it cannot be integrated.
static inline bool turn_cell(const Turning &t, Index cell, TurningWorkspace &room) {
    const Index stages = t.stages, first = cell * stages;
    const double step = t.duration / t.cells;
    const Matrix3 border = matrix3(t.borders + 9 * cell);
    const Vector3 h = vector3(t.momentum);
    const bool carries = dot(h, h) > 0;
    double *still = t.still_rates + 4 * first, *carried = t.carried_rates + 4 * first;
    for (Index k = first; k < first + stages; ++k) {
        const Matrix3 per_inertia = inverse(matrix3(t.inertia + 9 * k));
        store(t.inverse + 9 * k, per_inertia);
        store(t.rates + 3 * k, -(per_inertia * vector3(t.relative + 3 * k)));
    }
    Matrix3 swung, drifted = multiple(1.0);
    if (!spin(t, step, room, [&](Index k) { return vector3(t.rates + 3 * (first + k)); }, still, swung)) return false;
    for (Index k = 0; k < stages; ++k) {
        const Matrix3 swing = spun(t, step, still, k);
        store(t.attitudes + 9 * (first + k), swing);
        store(room.seen + 9 * k, swing * matrix3(t.inverse + 9 * (first + k)) * transposed(swing));
    }
    if (carries) {
        if (!carry_momentum(t, step, room, h * border)) return false;
        const auto rate = [&](Index k) { return matrix3(room.seen + 9 * k) * vector3(room.mu + 3 * k); };
        if (!spin(t, step, room, rate, carried, drifted)) return false;
    }
    for (Index k = 0; k < stages; ++k) {
        double *attitude = t.attitudes + 9 * (first + k), *turns = t.rates + 3 * (first + k);
        const Matrix3 swing = matrix3(attitude);
        if (carries)
            store(turns, vector3(turns) + matrix3(room.seen + 9 * k) * vector3(room.mu + 3 * k) * swing);
        store(attitude, border * (carries ? spun(t, step, carried, k) : drifted) * swing);
    }
    store(t.ends + 9 * cell, border * drifted * swung);
    return true;
}

// M [h]x at a stage.
static inline Matrix3 pulled(const Turning &t, Index stage) {
    const Matrix3 attitude = matrix3(t.attitudes + 9 * stage);
    return attitude * matrix3(t.inverse + 9 * stage) * transposed(attitude) * cross_matrix(vector3(t.momentum));
}

// How small turns go on in a cell: the transition (3, 3), and weights (stages, 3, 3) of g at the stages; false where
// that has no solution.
static inline bool carry_turns(const Turning &t, Index cell, TurningWorkspace &room) {
    const Index stages = t.stages, first = cell * stages, n = 3 * stages;
    const double step = t.duration / t.cells;
    double *matrix = room.matrix, *through = room.right;  // (n, 3): transposed
    collocate(t, step, 3, matrix, [&](Index k, double *of) { store(of, pulled(t, first + k)); });
    for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < i; ++j) std::swap(matrix[i * n + j], matrix[j * n + i]);
    for (Index k = 0; k < stages; ++k)
        store(through + 9 * k, t.weights[k] * transposed(pulled(t, first + k)));
    if (!eliminate(matrix, through, n, 3)) return false;
    Matrix3 transition = multiple(1.0);
    for (Index k = 0; k < stages; ++k) {
        Matrix3 weight = multiple(step * t.weights[k]);
        for (Index j = 0; j < stages; ++j)
            weight = weight + step * step * t.integrals[j * stages + k] * transposed(matrix3(through + 9 * j));
        store(t.turn_weights + 9 * (first + k), weight);
        transition = transition + step * transposed(matrix3(through + 9 * k));
    }
    store(t.transitions + 9 * cell, transition);
    return true;
}

// Small turns (instants, 3, columns) that drifts (cells stages, 3, columns) make, from none at takeoff on; each instant in
// a cell, after integrals from its beginning; false where that has no solution.
static inline bool carry_drifts(const Turning &t, Index cell, TurningWorkspace &room, double *border) {
    const Index stages = t.stages, columns = t.columns, of_stage = 3 * columns;
    const double step = t.duration / t.cells, *drifts = t.drifts + cell * stages * of_stage;
    double *inner = room.right;
    collocate(t, step, 3, room.matrix, [&](Index k, double *of) { store(of, pulled(t, cell * stages + k)); });
    for (Index j = 0; j < stages; ++j) {
        copy(inner + j * of_stage, border, of_stage);
        for (Index k = 0; k < stages; ++k)
            add(step * t.integrals[j * stages + k], drifts + k * of_stage, of_stage, inner + j * of_stage);
    }
    if (!eliminate(room.matrix, inner, 3 * stages, columns)) return false;
    for (Index k = 0; k < stages; ++k) {  // to how the turns grow
        double slope[9];
        store(slope, pulled(t, cell * stages + k));
        multiply(slope, 3, 3, inner + k * of_stage, columns, room.grown);
        add(1, drifts + k * of_stage, of_stage, room.grown);
        copy(inner + k * of_stage, room.grown, of_stage);
    }
    for (Index i = 0; i < t.instants; ++i) {
        if (t.cell[i] != cell) continue;
        copy(t.turns + i * of_stage, border, of_stage);
        for (Index k = 0; k < stages; ++k)
            add(step * t.reached[i * stages + k], inner + k * of_stage, of_stage, t.turns + i * of_stage);
    }
    for (Index k = 0; k < stages; ++k) add(step * t.weights[k], inner + k * of_stage, of_stage, border);
    return true;
}

// What is asked in all cells: the attitude, each from its border, or from where the last one ended; how small turns go
// on; or those that drifts make. False where it cannot be integrated.
static inline bool turn_cells(const Turning &t, Asked asked, TurningWorkspace &at) {
    zero(at.border, 3 * t.columns);
    for (Index cell = 0; cell < t.cells; ++cell) {
        if (asked == Asked::attitudes && t.is_chained && cell) copy(t.borders + 9 * cell, t.ends + 9 * (cell - 1), 9);
        if (!(asked == Asked::attitudes     ? turn_cell(t, cell, at)
              : asked == Asked::transitions ? carry_turns(t, cell, at)
                                            : carry_drifts(t, cell, at, at.border)))
            return false;
    }
    return true;
}

// The same; 0, or 1 where it cannot be integrated, 2 without memory.
Index turn_in_space(const Turning &t, Asked asked) {
    TurningWorkspace at;
    Workspace room;
    if (!room.make([&](Arena &arena) { at.lay_out(arena, t.stages, t.columns > 3 ? t.columns : 3); })) return 2;
    return turn_cells(t, asked, at) ? 0 : 1;
}
