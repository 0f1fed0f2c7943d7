// Quadratic programs by changes of the rows that are active.

// Solves M X = B, M (n, n) and B (n, columns) overwritten, by elimination with row exchanges; false where M is singular.
static inline bool eliminate(double *matrix, double *right, Index n, Index columns = 1) {
    for (Index k = 0; k < n; ++k) {
        Index pivot = k;
        for (Index i = k + 1; i < n; ++i)
            if (std::fabs(matrix[i * n + k]) > std::fabs(matrix[pivot * n + k])) pivot = i;
        if (!(std::fabs(matrix[pivot * n + k]) > 0)) return false;
        if (pivot != k) {
            for (Index j = k; j < n; ++j) std::swap(matrix[k * n + j], matrix[pivot * n + j]);
            for (Index c = 0; c < columns; ++c) std::swap(right[k * columns + c], right[pivot * columns + c]);
        }
        const double *above = matrix + k * n, per_pivot = 1 / above[k];
        for (Index i = k + 1; i < n; ++i) {
            const double factor = matrix[i * n + k] * per_pivot;
            if (factor == 0) continue;
            add(-factor, above + k + 1, n - k - 1, matrix + i * n + k + 1);
            add(-factor, right + k * columns, columns, right + i * columns);
        }
    }
    for (Index i = n; i-- > 0;) {
        const double *row = matrix + i * n;
        double *of = right + i * columns;
        for (Index j = i + 1; j < n; ++j) add(-row[j], right + j * columns, columns, of);
        for (Index c = 0; c < columns; ++c) of[c] /= row[i];
    }
    return true;
}

// The conditions of optimality with the active rows as equalities; whether the solution is as accurate as is asked.
static inline bool hold_active(Quadratic &qp, Index total, double *matrix) {
    const Index n = qp.size;
    double *factors = matrix + total * total, *right = factors + total * total, *solution = qp.solution;
    zero(matrix, total * total);
    for (Index i = 0; i < n; ++i) {
        copy(matrix + i * total, qp.hessian + i * n, n);
        right[i] = -qp.gradient[i];
    }
    for (Index k = n; k < total; ++k) {
        const Index place = k - n, row = place < qp.equalities ? place : qp.active[place - qp.equalities];
        const bool equality = place < qp.equalities;
        const double *slopes = (equality ? qp.equality_rows : qp.inequality_rows) + row * n;
        for (Index j = 0; j < n; ++j) matrix[k * total + j] = matrix[j * total + k] = slopes[j];
        right[k] = -(equality ? qp.equality : qp.inequality)[row];
    }
    copy(factors, matrix, total * total);
    copy(solution, right, total);
    if (!eliminate(factors, solution, total)) return false;
    double balanced = 0, unbalanced = 0, missed = 0;
    for (Index i = 0; i < total; ++i) {
        const double *row = matrix + i * total;
        const double curved = dot(row, solution, n), pulled = dot(row + n, solution + n, total - n);
        double &lacking = i < n ? unbalanced : missed;
        lacking = std::fmax(lacking, std::fabs(curved + pulled - right[i]));
        if (i < n) balanced = std::fmax(balanced, std::fmax(std::fabs(curved), std::fabs(right[i])));
        if (!std::isfinite(curved + pulled)) return false;
    }
    return unbalanced / (1 + balanced) <= qp.accuracy && missed <= qp.accuracy;
}

// The row most violated by the solution that is not active; -1 where none is by more than the tolerance.
static inline Index most_violated(const Quadratic &qp) {
    const Index n = qp.size;
    double least = -qp.tolerance;
    Index worst = -1;
    for (Index row = 0; row < qp.rows; ++row) {
        const double *slopes = qp.inequality_rows + row * n;
        double value = qp.inequality[row], other = 0;
        Index j = 0;
        for (; j + 1 < n; j += 2) {
            value += slopes[j] * qp.solution[j];
            other += slopes[j + 1] * qp.solution[j + 1];
        }
        if (j < n) value += slopes[j] * qp.solution[j];
        if (value + other < least) {
            bool held = false;
            for (Index k = 0; k < qp.count; ++k) held |= qp.active[k] == row;
            if (held) continue;
            least = value + other;
            worst = row;
        }
    }
    return worst;
}

// Whether it is solved; the direction and the multipliers are the solution, its active rows those that are kept.
static inline Index solve_quadratic(Quadratic &qp) {
    const Index first = qp.size + qp.equalities, largest = first + qp.size;
    double *matrix;
    Room room;
    if (!room.make([&](Arena &arena) { arena.take(matrix, (2 * largest + 1) * largest); })) return 0;
    for (Index change = 0; change < qp.changes && qp.count <= qp.size; ++change) {
        if (!hold_active(qp, first + qp.count, matrix)) return 0;
        const Index violated = most_violated(qp);
        Index kept = 0;
        for (Index k = 0; k < qp.count; ++k)
            if (qp.solution[first + k] <= 0) qp.active[kept++] = qp.active[k];
        if (kept == qp.count && violated < 0) return 1;
        qp.count = kept;
        if (violated >= 0) qp.active[qp.count++] = violated;
    }
    return 0;
}
