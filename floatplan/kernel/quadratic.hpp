// Quadratic programs by the dual method of Goldfarb and Idnani (Mathematical Programming 27 (1983)): from the solution
// without rows, one violated row after the other is made active; rows that are pulled at on the way leave. With the
// active normals N and H = L L^T the factors J = L^-T Q and R, J^T N = (R; 0), are kept up to date by rotations.

#ifndef OBSERVE_QUADRATIC  // benchmarks/recorded_quadratics.py compiles in what writes down the programs that a search meets
#define OBSERVE_QUADRATIC(qp)
#endif

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
        // In whole vectors to the end of the row: what they change on the left of the next pivot is not read any more.
        const Index padded = n - (n - k - 1 + LANES - 1) / LANES * LANES, begin = padded < 0 ? k + 1 : padded;
        for (Index i = k + 1; i < n; ++i) {
            const double factor = matrix[i * n + k] * per_pivot;
            if (factor == 0) continue;
            add(-factor, above + begin, n - begin, matrix + i * n + begin);
            add(-factor, right + k * columns, columns, right + i * columns);
        }
    }
    for (Index i = n; i-- > 0;) {
        const double *row = matrix + i * n;
        double *of = right + i * columns;
        if (columns == 1) of[0] = -dot(row + i + 1, right + i + 1, n - i - 1, -of[0]);
        else for (Index j = i + 1; j < n; ++j) add(-row[j], right + j * columns, columns, of);
        for (Index c = 0; c < columns; ++c) of[c] /= row[i];
    }
    return true;
}

// Factor L of H = L L^T (n, n), below and on the diagonal of `factor`, with something added to H's diagonal; false where
// H is not positive definite. L^T is made first, row by row above the diagonal: its sums go along rows.
static inline bool cholesky(const double *matrix, Index n, double *factor, double added = 0) {
    for (Index j = 0; j < n; ++j) {
        double *row = factor + j * n;
        zero(row + j, n - j);
        for (Index k = 0; k < j; ++k) add(factor[k * n + j], factor + k * n + j, n - j, row + j);
        const double left = matrix[j * n + j] + added - row[j];
        if (!(left > 0 && std::isfinite(left))) return false;
        row[j] = std::sqrt(left);
        for (Index i = j + 1; i < n; ++i) row[i] = (matrix[i * n + j] - row[i]) / row[j];
    }
    for (Index i = 1; i < n; ++i)
        for (Index j = 0; j < i; ++j) factor[i * n + j] = factor[j * n + i];
    return true;
}

// Solves L L^T x = b, b (n) overwritten.
static inline void solve_cholesky(const double *factor, Index n, double *right) {
    for (Index i = 0; i < n; ++i) right[i] = (right[i] - dot(factor + i * n, right, i)) / factor[i * n + i];
    for (Index i = n; i-- > 0;) {
        right[i] /= factor[i * n + i];
        add(-right[i], factor + i * n, i, right);
    }
}

class DualMethod {
  public:
    Index count = 0, held = 0;  // of the active ones: all, and equalities, which come first
    Index changes = 0;          // of rows that became active or left
    Index *active;              // (size): which equality or row each is
    double *x, *multipliers;          // (size): the solution; multipliers of the active ones, those of rows >= 0

    void lay_out(Arena &arena, Index size, Index most_rows) {
        for (double **each : {&j, &r, &factor}) arena.take(*each, size * size);
        arena.take(wide, size * across_of(size));
        for (double **each : {&x, &multipliers, &d, &z, &by, &normal}) arena.take(*each, size + 1);
        arena.take(active, size + 1);
        arena.take(idle, most_rows);
    }

    // Whether it is solved; where rows contradict one another it is not. Some rows, which are likely to be active, are looked
    // at first: fewer others become active only to leave again.
    bool solve(const Quadratic &qp, const Index *likely = nullptr, Index likely_count = 0) {
        OBSERVE_QUADRATIC(qp);
        n = qp.size;
        count = held = changes = 0;
        if (qp.equalities == 1 && !qp.rows && hold_alone(qp)) return true;
        if (!start(qp)) return false;
        copy(idle, qp.inequality, qp.rows);
        for (Index e = 0; e < qp.equalities; ++e)
            if (!hold_equality(qp, e)) return false;
        for (Index k = 0; k < likely_count; ++k)
            if (is_violated(qp, likely[k]) && (count > n || !hold_row(qp, likely[k]))) return false;
        return hold_violated(qp);
    }

    // The same of the program solved last, to which rows have been added: from its solution on.
    bool resume(const Quadratic &qp) {
        changes = 0;
        copy(idle, qp.inequality, qp.rows);
        for (Index k = held; k < count; ++k) idle[active[k]] = HUGE_VAL;
        return hold_violated(qp);
    }

  private:
    static constexpr double dependent = 1e-10;  // of a normal's length: what is left of it is rounding
    // What is added to the diagonal of a Hessian that is singular or nearly so, of its largest entry: the first of these
    // that makes it positive definite. It is a proximal term: without it the factors would be large, and the residuals
    // with them. One that is further from singular than the first shift is taken as it is.
    static constexpr double shifts[] = {1e-8, 1e-6, 1e-4, 1e-2};
    Index n = 0;
    double *j, *r, *factor, *wide, *d, *z, *by, *normal;
    double *idle;           // (rows): values before the step, of active rows infinite

    // L of the Hessian, shifted where that is needed; false where no shift makes it positive definite.
    bool factorise(const double *hessian) {
        double most = 0, least_pivot = HUGE_VAL;
        for (Index k = 0; k < n; ++k) most = larger(most, hessian[k * n + k]);
        if (cholesky(hessian, n, factor)) {
            for (Index k = 0; k < n; ++k) least_pivot = smaller(least_pivot, factor[k * n + k] * factor[k * n + k]);
            if (least_pivot > shifts[0] * most) return true;
        }
        for (double shift : shifts)
            if (cholesky(hessian, n, factor, shift * most)) return true;
        return false;
    }

    // J = L^-T, and the solution without rows.
    bool start(const Quadratic &qp) {
        const bool is_plain = is_identity(qp.hessian);
        if (!is_plain && !factorise(qp.hessian)) return false;
        for (Index k = 0; k < n; ++k) {
            if (!std::isfinite(qp.gradient[k])) return false;
            x[k] = -qp.gradient[k];
        }
        zero(j, n * n);
        if (is_plain) {
            for (Index k = 0; k < n; ++k) j[k * n + k] = 1;
            return true;
        }
        solve_cholesky(factor, n, x);
        const Index across = across_of(n);
        for (Index i = 0; i < n; ++i) {  // row i of L^-1 is column i of L^-T
            double *row = wide + i * across;
            zero(row, i + 1);
            for (Index k = 0; k < i; ++k) add(factor[i * n + k], wide + k * across, k + 1, row);
            for (Index c = 0; c <= i; ++c) j[c * n + i] = row[c] = ((i == c) - row[c]) / factor[i * n + i];
        }
        return true;
    }

    bool is_identity(const double *hessian) const {
        for (Index i = 0; i < n; ++i)
            for (Index k = 0; k < n; ++k)
                if (hessian[i * n + k] != (i == k)) return false;
        return true;
    }

    static Index across_of(Index size) { return (size + 2 + 7) / 8 * 8; }

    // One equality and nothing else, by an elimination of H with -g and the equality's derivatives a beside it, whole rows
    // at a time: x = -H^-1 g + y H^-1 a. False where H is singular or nearly so, or a is next to nothing.
    bool hold_alone(const Quadratic &qp) {
        const double *row = qp.equality_rows;
        const Index across = across_of(n);
        double most = 0;
        for (Index k = 0; k < n; ++k) {
            copy(wide + k * across, qp.hessian + k * n, n);
            wide[k * across + n] = -qp.gradient[k];
            wide[k * across + n + 1] = row[k];
            zero(wide + k * across + n + 2, across - n - 2);
            most = larger(most, qp.hessian[k * n + k]);
        }
        for (Index k = 0; k < n; ++k) {
            const double *above = wide + k * across;
            if (!(above[k] > shifts[0] * most)) return false;
            const double per_pivot = 1 / above[k];
            for (Index i = k + 1; i < n; ++i) {
                const Vector factor = all(-above[i] * per_pivot);
                double *own = wide + i * across;
                for (Index c = i / LANES * LANES; c < across; c += LANES)  // what is before i counts no more
                    store(own + c, multiply_add(factor, load(above + c), load(own + c)));
            }
        }
        for (Index i = n; i-- > 0;) {
            const double *own = wide + i * across, per_pivot = 1 / own[i];
            double of_gradient = own[n], of_row = own[n + 1];
            for (Index k = i + 1; k < n; ++k) {
                of_gradient -= own[k] * x[k];
                of_row -= own[k] * z[k];
            }
            x[i] = of_gradient * per_pivot;
            z[i] = of_row * per_pivot;
        }
        const double value = qp.equality[0] + dot(row, x, n), curvature = dot(row, z, n);
        if (!std::isfinite(value) || !(curvature > dependent * dependent)) return false;
        multipliers[0] = -value / curvature;
        active[0] = 0;
        count = held = 1;
        add(multipliers[0], z, n, x);
        return true;
    }

    // d = J^T normal; z, the way in x that leaves the active ones as they are, and `by`, what their multipliers lose.
    // The square of what is left of the normal, 0 where it is made of theirs.
    double look(const double *row) {
        zero(d, n);
        for (Index i = 0; i < n; ++i) add(row[i], j + i * n, n, d);
        const double whole = dot(d, d, n), left = dot(d + count, d + count, n - count);
        multiply_vector(j + count, n, n - count, n, d + count, z);
        for (Index i = count; i-- > 0;)
            by[i] = (d[i] - dot(r + i * n + i + 1, by + i + 1, count - i - 1)) / r[i * n + i];
        return left > dependent * dependent * whole ? left : 0;
    }

    void rotate(double *matrix, Index rows, Index one, double cosine, double sine) const {
        for (Index i = 0; i < rows; ++i) {
            double &a = matrix[i * n + one], &b = matrix[i * n + one + 1], old = a;
            a = cosine * old + sine * b;
            b = cosine * b - sine * old;
        }
    }

    void enter(Index row, double multiplier) {
        for (Index k = n - 1; k > count; --k) {
            const double length = std::sqrt(d[k - 1] * d[k - 1] + d[k] * d[k]);
            if (length == 0) continue;
            rotate(j, n, k - 1, d[k - 1] / length, d[k] / length);
            d[k - 1] = length;
        }
        for (Index i = 0; i <= count; ++i) r[i * n + count] = d[i];
        active[count] = row;
        multipliers[count++] = multiplier;
    }

    void leave(Index place) {
        --count;
        for (Index c = place; c < count; ++c) {
            active[c] = active[c + 1];
            multipliers[c] = multipliers[c + 1];
            for (Index i = 0; i <= c + 1; ++i) r[i * n + c] = r[i * n + c + 1];
        }
        for (Index c = place; c < count; ++c) {
            double &a = r[c * n + c], &b = r[(c + 1) * n + c];
            const double length = std::sqrt(a * a + b * b);
            if (length == 0) continue;
            const double cosine = a / length, sine = b / length;
            for (Index k = c + 1; k < count; ++k) {
                double &upper = r[c * n + k], &lower = r[(c + 1) * n + k], old = upper;
                upper = cosine * old + sine * lower;
                lower = cosine * lower - sine * old;
            }
            a = length;
            b = 0;
            rotate(j, n, c, cosine, sine);
        }
    }

    // Makes rows active until none is violated.
    bool hold_violated(const Quadratic &qp) {
        for (; changes <= qp.changes; ++changes) {
            const Index row = most_violated(qp);
            if (row < 0) return true;
            if (count > n || !hold_row(qp, row)) return false;
        }
        return false;
    }

    bool is_violated(const Quadratic &qp, Index row) const {
        double value = idle[row];
        for (Index k = 0; k < n; ++k) value += x[k] * qp.inequality_rows[(row / 8 * n + k) * 8 + row % 8];
        return value < -qp.tolerance;
    }

    bool hold_equality(const Quadratic &qp, Index e) {
        const double *row = qp.equality_rows + e * n, value = qp.equality[e] + dot(row, x, n);
        const double left = look(row);
        if (!std::isfinite(value)) return false;
        if (left == 0) return std::fabs(value) <= qp.tolerance;
        const double step = -value / left;
        add(step, z, n, x);
        add(-step, by, count, multipliers);
        enter(e, step);
        ++held;
        return true;
    }

    // Makes a violated row active; false where the others forbid that, or it takes too many changes.
    bool hold_row(const Quadratic &qp, Index row) {
        for (Index k = 0; k < n; ++k) normal[k] = qp.inequality_rows[(row / 8 * n + k) * 8 + row % 8];
        double multiplier = 0;
        for (; changes <= qp.changes; ++changes) {
            const double left = look(normal), value = qp.inequality[row] + dot(normal, x, n);
            double step = left > 0 ? -value / left : HUGE_VAL;
            Index first = -1;
            for (Index k = held; k < count; ++k)
                if (by[k] > 0 && multipliers[k] < step * by[k]) {
                    step = multipliers[k] / by[k];
                    first = k;
                }
            if (!(step < HUGE_VAL)) return false;
            if (left > 0) add(step, z, n, x);
            add(-step, by, count, multipliers);
            multiplier += step;
            if (first < 0) {
                enter(row, multiplier);
                idle[row] = HUGE_VAL;
                return true;
            }
            idle[active[first]] = qp.inequality[active[first]];
            leave(first);
        }
        return false;
    }

    // The row most violated; -1 where none is by more than the tolerance.
    Index most_violated(const Quadratic &qp) {
        Vector lowest_value = all(-qp.tolerance);
        Bits worst = Bits{} - 1;
        for (Index row = 0; row < qp.rows; row += LANES) {
            const double *slopes = qp.inequality_rows + row / 8 * n * 8 + row % 8;
            Vector value = load(idle + row);
            for (Index k = 0; k < n; ++k) value = add_product(x[k], load(slopes + 8 * k), value);
            const Bits lower = ~(value >= lowest_value) & (lowest_value == lowest_value);  // so that what is no number is found too
            lowest_value = select(lower, value, lowest_value);
            worst = (lower & row) | (~lower & worst);
        }
        int lowest = 0;
        for (int lane = 1; lane < LANES; ++lane)
            if (!(lowest_value[lane] >= lowest_value[lowest]) && lowest_value[lowest] == lowest_value[lowest]) lowest = lane;
        return worst[lowest] < 0 ? -1 : worst[lowest] + lowest;
    }
};

// Whether it is solved; the direction and the multipliers are the solution, the active rows those that it needs.
Index solve_quadratic(Quadratic &qp) {
    DualMethod method;
    Workspace room;
    const bool solved = room.make([&](Arena &arena) { method.lay_out(arena, qp.size, qp.rows); }) && method.solve(qp);
    qp.changes = method.changes;
    if (!solved) return 0;
    zero(qp.solution, qp.size + qp.equalities);
    copy(qp.solution, method.x, qp.size);
    for (Index k = 0; k < method.held; ++k) qp.solution[qp.size + method.active[k]] = -method.multipliers[k];
    qp.count = method.count - method.held;
    copy(qp.solution + qp.size + qp.equalities, method.multipliers + method.held, qp.count);
    for (Index k = 0; k < qp.count; ++k) qp.active[k] = method.active[method.held + k];
    return 1;
}
