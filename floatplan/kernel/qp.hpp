// Small strictly convex quadratic programs by the dual method of Goldfarb and Idnani (Mathematical Programming 27
// (1983)): minimise x H x / 2 + g x subject to A x = b and C x >= l.

static inline double along_row(const double *a, const double *b, std::int64_t n) {
    double one = 0, two = 0, three = 0, four = 0;
    std::int64_t i = 0;
    for (; i + 4 <= n; i += 4) {
        one += a[i] * b[i];
        two += a[i + 1] * b[i + 1];
        three += a[i + 2] * b[i + 2];
        four += a[i + 3] * b[i + 3];
    }
    for (; i < n; ++i) one += a[i] * b[i];
    return (one + two) + (three + four);
}

struct DualMethod {
    const Quadratic &qp;
    const std::int64_t n;
    double *J, *R, *x, *d, *z, *r, *u;  // J (n, n) transposed: H^-1 = sum of j j^T; R (n, n) by columns
    std::int64_t *active;               // (n): rows of C, the equalities -1
    std::int64_t count = 0;

    explicit DualMethod(const Quadratic &qp) : qp(qp), n(qp.size) {
        double *room = qp.room;
        for (double **part : {&J, &R}) *part = room, room += n * n;
        for (double **part : {&x, &d, &z, &r, &u}) *part = room, room += n + 1;
        active = qp.active;
    }

    // J from the Cholesky factor L of H: the rows of L^-1.
    bool factor() {
        double *L = R;
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t j = 0; j <= i; ++j) {
                double rest = qp.hessian[i * n + j] - along_row(L + i * n, L + j * n, j);
                if (i == j && !(rest > 0)) return false;
                L[i * n + j] = i == j ? std::sqrt(rest) : rest / L[j * n + j];
            }
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t j = 0; j < n; ++j) {
                double rest = i == j;
                for (std::int64_t k = j; k < i; ++k) rest -= L[i * n + k] * J[k * n + j];
                J[i * n + j] = j > i ? 0 : rest / L[i * n + i];
            }
        return true;
    }

    // How a row moves x (z) and the multipliers of the active ones (r).
    void directions(const double *row) {
        for (std::int64_t i = 0; i < n; ++i) d[i] = along_row(J + i * n, row, n);
        for (std::int64_t j = 0; j < n; ++j) z[j] = 0;
        for (std::int64_t i = count; i < n; ++i)
            for (std::int64_t j = 0; j < n; ++j) z[j] += d[i] * J[i * n + j];
        for (std::int64_t i = count; i-- > 0;) {
            double rest = d[i];
            for (std::int64_t k = i + 1; k < count; ++k) rest -= R[k * n + i] * r[k];
            r[i] = rest / R[i * n + i];
        }
    }

    void rotate(std::int64_t i, double cosine, double sine) {  // rows i and i + 1 of J
        double *a = J + i * n, *b = a + n;
        for (std::int64_t j = 0; j < n; ++j) {
            double one = a[j], other = b[j];
            a[j] = cosine * one + sine * other;
            b[j] = cosine * other - sine * one;
        }
    }

    bool add(std::int64_t row) {
        for (std::int64_t i = n - 2; i >= count; --i) {
            double length = std::hypot(d[i], d[i + 1]);
            if (!(length > 0)) continue;
            rotate(i, d[i] / length, d[i + 1] / length);
            d[i] = length;
            d[i + 1] = 0;
        }
        if (!(std::fabs(d[count]) > 1e-12 * largest_of(d, count + 1))) return false;
        for (std::int64_t i = 0; i <= count; ++i) R[count * n + i] = d[i];
        active[count++] = row;
        return true;
    }

    static double largest_of(const double *values, std::int64_t count) {
        double most = 0;
        for (std::int64_t i = 0; i < count; ++i) most = larger(most, std::fabs(values[i]));
        return most;
    }

    void drop(std::int64_t place) {
        for (std::int64_t k = place; k + 1 < count; ++k) {
            for (std::int64_t i = 0; i < k + 2; ++i) R[k * n + i] = R[(k + 1) * n + i];
            active[k] = active[k + 1];
            u[k] = u[k + 1];
        }
        u[count - 1] = u[count];  // of the row that is being added
        --count;
        for (std::int64_t k = place; k < count; ++k) {
            double a = R[k * n + k], b = R[k * n + k + 1], length = std::hypot(a, b);
            if (!(length > 0)) continue;
            double cosine = a / length, sine = b / length;
            for (std::int64_t column = k; column < count; ++column) {
                double *entry = R + column * n + k, one = entry[0], other = entry[1];
                entry[0] = cosine * one + sine * other;
                entry[1] = cosine * other - sine * one;
            }
            rotate(k, cosine, sine);
        }
    }

    // Moves until the row holds, and makes it active; false where that cannot be.
    bool satisfy(const double *row, double bound, std::int64_t index) {
        u[count] = 0;
        for (std::int64_t drops = 0; drops <= n; ++drops) {
            directions(row);
            double along = along_row(z, row, n), lacking = bound - along_row(row, x, n);
            double full = along > 1e-14 * along_row(d, d, n) ? lacking / along : HUGE_VAL, partial = HUGE_VAL;
            std::int64_t blocking = -1;
            for (std::int64_t k = 0; k < count; ++k)
                if (active[k] >= 0 && r[k] > 0 && u[k] < partial * r[k]) {
                    partial = u[k] / r[k];
                    blocking = k;
                }
            double step = index < 0 ? full : smaller(full, partial);
            if (!std::isfinite(step)) return false;
            if (full < HUGE_VAL)
                for (std::int64_t j = 0; j < n; ++j) x[j] += step * z[j];
            for (std::int64_t k = 0; k < count; ++k) u[k] -= step * r[k];
            u[count] += step;
            if (index < 0 || full <= partial) return count < n && add(index);
            drop(blocking);
        }
        return false;
    }

    // Whether it is solved; x and the multipliers are kept.
    bool solve() {
        if (!factor()) return false;
        for (std::int64_t i = 0; i < n; ++i) d[i] = along_row(J + i * n, qp.gradient, n);
        for (std::int64_t j = 0; j < n; ++j) x[j] = 0;
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t j = 0; j < n; ++j) x[j] -= d[i] * J[i * n + j];
        for (std::int64_t e = 0; e < qp.equalities; ++e)
            if (!satisfy(qp.equality_rows + e * n, -qp.equality[e], -1)) return false;
        for (std::int64_t looks = 0; looks < qp.most; ++looks) {
            std::int64_t violated = 0;
            for (std::int64_t row = 0; row < qp.rows; ++row)
                if (qp.inequality[row] + along_row(qp.inequality_rows + row * n, x, n) < -qp.tolerance)
                    qp.violated[violated++] = row;
            if (!violated) return true;
            for (std::int64_t steps = 0; steps < qp.most; ++steps) {
                double least = -qp.tolerance;
                std::int64_t worst = -1;
                for (std::int64_t k = 0; k < violated; ++k) {
                    const std::int64_t row = qp.violated[k];
                    double value = qp.inequality[row] + along_row(qp.inequality_rows + row * n, x, n);
                    if (value < least) {
                        least = value;
                        worst = row;
                    }
                }
                if (worst < 0) break;
                if (!satisfy(qp.inequality_rows + worst * n, -qp.inequality[worst], worst)) return false;
            }
        }
        return false;
    }
};

static inline std::int64_t solve_quadratic(Quadratic &qp) {
    DualMethod method(qp);
    if (!method.solve()) return 1;
    std::memcpy(qp.x, method.x, qp.size * sizeof(double));
    std::memset(qp.multipliers, 0, (qp.equalities + qp.rows) * sizeof(double));
    std::int64_t equality = 0;
    for (std::int64_t k = 0; k < method.count; ++k) {
        if (method.active[k] < 0)
            qp.multipliers[equality++] = -method.u[k];
        else
            qp.multipliers[qp.equalities + method.active[k]] = method.u[k];
    }
    return 0;
}
