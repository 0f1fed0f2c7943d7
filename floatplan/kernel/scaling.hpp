// Variables in which (17) is half a sum of squares, but for a constant: whitened_variables() of
// planning/transcription/variables.py.

inline void Planner::whiten(double duration, const Powers &powers) {
    T = duration;
    double longest = 0;
    for (Index f = 0; f <= width; ++f) {
        bool used = false;
        for (Index i = 0; i < n; ++i) used = used || robot.free[i] == f;
        if (!used) continue;
        factor(f, powers);
        if (f) longest = larger(longest, norm(m.scaling + f * width * width, f));
    }
    unit = longest > 0 ? 1 / longest : 1;
    double square = 0;
    for (Index i = 0; i < n; ++i) {
        const double *inverse = m.scaling + robot.free[i] * width * width;
        for (Index e = 0; e < robot.free[i] * robot.free[i]; ++e) square += inverse[e] * inverse[e];
    }
    metric_norm = unit * std::sqrt(square / n);
}

inline void Planner::set_boundary(const double *boundary) {
    copy(m.boundary, boundary, 6 * n);
    each_joint([&](Index i, Index f, const double *, Index first) {
        multiply(m.offset_map + f * width * 6, f, 6, boundary + 6 * i, 1, m.offset + first);
    });
    level = -1;
}

inline void Planner::free_coefficients(const double *x) {
    zero(m.z, n * width);
    each_joint([&](Index i, Index f, const double *inverse, Index first) {
        for (Index r = 0; r < f; ++r)
            m.z[i * width + r] = m.offset[first + r] + unit * dot(inverse + r * f + r, x + first + r, f - r);
    });
}

inline void Planner::variables(const double *z, double *x) const {
    each_joint([&](Index i, Index f, const double *inverse, Index first) {
        for (Index r = f - 1; r >= 0; --r) {
            double rest = (z[i * width + r] - m.offset[first + r]) / unit;
            for (Index c = r + 1; c < f; ++c) rest -= inverse[r * f + c] * x[first + c];
            x[first + r] = rest / inverse[r * f + r];
        }
    });
}

inline double Planner::metric(const double *d) const {
    double square = 0;
    each_joint([&](Index, Index f, const double *inverse, Index first) {
        for (Index r = 0; r < f; ++r) {
            const double part = dot(inverse + r * f + r, d + first + r, f - r);
            square += part * part;
        }
    });
    return unit * std::sqrt(square / n);
}

// Householder's C = Q R of the columns of f free polynomials in powers of seconds: R^-1 and -R^-1 Q^T b_0.
inline void Planner::factor(Index f, const Powers &powers) {
    Index rows = columns, across = f + 6;
    double *a = m.matrix;  // (rows, f + 6): free columns, then those of the boundary
    double per_power = 1;
    for (Index r = 0; r < rows; ++r, per_power /= T)
        for (Index c = 0; c < across; ++c)
            a[r * across + c] = powers.columns[r * columns + (c < f ? 6 + c : c - f)] * per_power;
    for (Index c = 0; c < f; ++c) {
        double square = 0, largest = 0;
        for (Index r = c; r < rows; ++r) largest = larger(largest, std::fabs(a[r * across + c]));
        for (Index r = c; r < rows; ++r) {
            double part = a[r * across + c] / largest;
            square += part * part;
        }
        double length = std::copysign(largest * std::sqrt(square), a[c * across + c]);
        double head = a[c * across + c] + length;  // the reflection's vector is (1, a[r] / head)
        for (Index r = c + 1; r < rows; ++r) a[r * across + c] /= head;
        for (Index k = c + 1; k < across; ++k) {
            double part = a[c * across + k];
            for (Index r = c + 1; r < rows; ++r) part += a[r * across + c] * a[r * across + k];
            part *= head / length;
            a[c * across + k] -= part;
            for (Index r = c + 1; r < rows; ++r) a[r * across + k] -= part * a[r * across + c];
        }
        a[c * across + c] = -length;
    }
    double *inverse = m.scaling + f * width * width, *map = m.offset_map + f * width * 6;
    for (Index c = 0; c < f; ++c)
        for (Index r = f - 1; r >= 0; --r) {
            double rest = r == c;
            for (Index k = r + 1; k <= c; ++k) rest -= a[r * across + k] * inverse[k * f + c];
            inverse[r * f + c] = r > c ? 0 : rest / a[r * across + r];
        }
    for (Index r = 0; r < f; ++r)
        for (int c = 0; c < 6; ++c) {
            double part = 0;
            for (Index k = r; k < f; ++k) part -= inverse[r * f + k] * a[k * across + f + c];
            map[6 * r + c] = part;
        }
}

// Largest singular value of an upper triangular matrix (f, f), by the power method.
inline double Planner::norm(const double *matrix, Index f) const {
    double *v = m.matrix, *w = v + f, value = 0;
    for (Index k = 0; k < f; ++k) v[k] = 1;
    for (int step = 0; step < 200; ++step) {
        for (Index r = 0; r < f; ++r) w[r] = dot(matrix + r * f + r, v + r, f - r);
        const double before = value, square = dot(w, w, f);
        value = std::sqrt(square / dot(v, v, f));
        if (std::fabs(value - before) <= 1e-14 * value) break;
        for (Index c = 0; c < f; ++c) {
            v[c] = 0;
            for (Index r = 0; r <= c; ++r) v[c] += matrix[r * f + c] * w[r];
            v[c] /= square;  // only against overflow
        }
    }
    return value;
}
