// Quadratic programs by changes of the rows that are active.

// Solves M x = b, M (n, n) and b overwritten, by elimination with row exchanges; false where M is singular.
static inline bool eliminate(double *matrix, double *right, std::int64_t n) {
    for (std::int64_t k = 0; k < n; ++k) {
        std::int64_t pivot = k;
        for (std::int64_t i = k + 1; i < n; ++i)
            if (std::fabs(matrix[i * n + k]) > std::fabs(matrix[pivot * n + k])) pivot = i;
        if (!(std::fabs(matrix[pivot * n + k]) > 0)) return false;
        if (pivot != k) {
            for (std::int64_t j = k; j < n; ++j) std::swap(matrix[k * n + j], matrix[pivot * n + j]);
            std::swap(right[k], right[pivot]);
        }
        const double *above = matrix + k * n, per_pivot = 1 / above[k];
        for (std::int64_t i = k + 1; i < n; ++i) {
            double *row = matrix + i * n, factor = row[k] * per_pivot;
            if (factor == 0) continue;
            for (std::int64_t j = k + 1; j < n; ++j) row[j] -= factor * above[j];
            right[i] -= factor * right[k];
        }
    }
    for (std::int64_t i = n; i-- > 0;) {
        const double *row = matrix + i * n;
        for (std::int64_t j = i + 1; j < n; ++j) right[i] -= row[j] * right[j];
        right[i] /= row[i];
    }
    return true;
}

// The conditions of optimality with the active rows as equalities; whether the solution is as accurate as is asked.
static inline bool hold_active(Quadratic &qp, std::int64_t total, double *matrix) {
    const std::int64_t n = qp.size;
    double *factors = matrix + total * total, *solution = qp.solution;
    std::memset(matrix, 0, total * total * sizeof(double));
    for (std::int64_t i = 0; i < n; ++i) {
        std::memcpy(matrix + i * total, qp.hessian + i * n, n * sizeof(double));
        solution[i] = -qp.gradient[i];
    }
    for (std::int64_t k = n; k < total; ++k) {
        const std::int64_t place = k - n, row = place < qp.equalities ? place : qp.active[place - qp.equalities];
        const bool equality = place < qp.equalities;
        const double *slopes = (equality ? qp.equality_rows : qp.inequality_rows) + row * n;
        for (std::int64_t j = 0; j < n; ++j) matrix[k * total + j] = matrix[j * total + k] = slopes[j];
        solution[k] = -(equality ? qp.equality : qp.inequality)[row];
    }
    std::memcpy(factors, matrix, total * total * sizeof(double));
    if (!eliminate(factors, solution, total)) return false;
    double balanced = 0, unbalanced = 0, missed = 0;
    for (std::int64_t i = 0; i < total; ++i) {
        const double *row = matrix + i * total;
        double curved = 0, pulled = 0;
        for (std::int64_t j = 0; j < n; ++j) curved += row[j] * solution[j];
        for (std::int64_t j = n; j < total; ++j) pulled += row[j] * solution[j];
        if (i < n) {
            balanced = std::fmax(balanced, std::fmax(std::fabs(curved), std::fabs(qp.gradient[i])));
            unbalanced = std::fmax(unbalanced, std::fabs(curved + pulled + qp.gradient[i]));
        } else {
            const std::int64_t place = i - n;
            const double lacking = place < qp.equalities ? qp.equality[place]
                                                         : qp.inequality[qp.active[place - qp.equalities]];
            missed = std::fmax(missed, std::fabs(curved + lacking));
        }
        if (!std::isfinite(curved + pulled)) return false;
    }
    return unbalanced / (1 + balanced) <= qp.accuracy && missed <= qp.accuracy;
}

// The row most violated by the solution that is not active; -1 where none is by more than the tolerance.
static inline std::int64_t most_violated(const Quadratic &qp) {
    const std::int64_t n = qp.size;
    double least = -qp.tolerance;
    std::int64_t worst = -1;
    for (std::int64_t row = 0; row < qp.rows; ++row) {
        const double *slopes = qp.inequality_rows + row * n;
        double value = qp.inequality[row], other = 0;
        std::int64_t j = 0;
        for (; j + 1 < n; j += 2) {
            value += slopes[j] * qp.solution[j];
            other += slopes[j + 1] * qp.solution[j + 1];
        }
        if (j < n) value += slopes[j] * qp.solution[j];
        if (value + other < least) {
            bool held = false;
            for (std::int64_t k = 0; k < qp.count; ++k) held |= qp.active[k] == row;
            if (held) continue;
            least = value + other;
            worst = row;
        }
    }
    return worst;
}

// Whether it is solved; the direction and the multipliers are the solution, its active rows those that are kept.
static inline std::int64_t solve_quadratic(Quadratic &qp) {
    const std::int64_t first = qp.size + qp.equalities, largest = first + qp.size;
    double *matrix;
    Room room;
    if (!room.make([&](Arena &arena) { arena.take(matrix, 2 * largest * largest); })) return 0;
    for (std::int64_t change = 0; change < qp.changes && qp.count <= qp.size; ++change) {
        if (!hold_active(qp, first + qp.count, matrix)) return 0;
        const std::int64_t violated = most_violated(qp);
        std::int64_t kept = 0;
        for (std::int64_t k = 0; k < qp.count; ++k)
            if (qp.solution[first + k] <= 0) qp.active[kept++] = qp.active[k];
        if (kept == qp.count && violated < 0) return 1;
        qp.count = kept;
        if (violated >= 0) qp.active[qp.count++] = violated;
    }
    return 0;
}
