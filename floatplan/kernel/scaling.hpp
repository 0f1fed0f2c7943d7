// Variables in which (17) is half a sum of squares, but for a constant: whitened_variables() of
// planning/transcription/objectives.py.

inline void Planner::whiten(double duration, const Powers &powers) {
    T = duration;
    double longest = 0;
    for (std::int64_t f = 0; f <= width; ++f) {
        bool used = false;
        for (std::int64_t i = 0; i < n; ++i) used = used || robot.free[i] == f;
        if (!used) continue;
        factor(f, powers);
        if (f) longest = larger(longest, norm(m.scaling + f * width * width, f));
    }
    unit = longest > 0 ? 1 / longest : 1;
    double square = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        const double *inverse = m.scaling + robot.free[i] * width * width;
        for (std::int64_t e = 0; e < robot.free[i] * robot.free[i]; ++e) square += inverse[e] * inverse[e];
    }
    metric_norm = unit * std::sqrt(square / n);
}

inline void Planner::set_boundary(const double *boundary) {
    std::memcpy(m.boundary, boundary, 6 * n * sizeof(double));
    double *offset = m.offset;
    least = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        std::int64_t f = robot.free[i];
        const double *map = m.offset_map + f * width * 6, *rest = m.rest + f * columns * 6;
        auto mapped = [&](const double *row) {
            double part = 0;
            for (int c = 0; c < 6; ++c) part += row[c] * boundary[6 * i + c];
            return part;
        };
        for (std::int64_t r = 0; r < f; ++r) *offset++ = mapped(map + 6 * r);
        for (std::int64_t r = f; r < columns; ++r) least += mapped(rest + 6 * r) * mapped(rest + 6 * r);
    }
    level = -1;
}

inline void Planner::free_coefficients(const double *x) {
    const double *offset = m.offset;
    for (std::int64_t i = 0; i < n; ++i) {
        std::int64_t f = robot.free[i];
        const double *inverse = m.scaling + f * width * width;
        for (std::int64_t r = 0; r < f; ++r) {
            double part = 0;
            for (std::int64_t c = r; c < f; ++c) part += inverse[r * f + c] * x[c];
            m.z[i * width + r] = offset[r] + unit * part;
        }
        for (std::int64_t r = f; r < width; ++r) m.z[i * width + r] = 0;
        x += f, offset += f;
    }
}

inline void Planner::variables(const double *z, double *x) const {
    const double *offset = m.offset;
    for (std::int64_t i = 0; i < n; ++i) {
        std::int64_t f = robot.free[i];
        const double *inverse = m.scaling + f * width * width;
        for (std::int64_t r = f - 1; r >= 0; --r) {
            double rest = (z[i * width + r] - offset[r]) / unit;
            for (std::int64_t c = r + 1; c < f; ++c) rest -= inverse[r * f + c] * x[c];
            x[r] = rest / inverse[r * f + r];
        }
        x += f, offset += f;
    }
}

inline double Planner::metric(const double *d) const {
    double square = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        std::int64_t f = robot.free[i];
        const double *inverse = m.scaling + f * width * width;
        for (std::int64_t r = 0; r < f; ++r) {
            double part = 0;
            for (std::int64_t c = r; c < f; ++c) part += inverse[r * f + c] * d[c];
            square += part * part;
        }
        d += f;
    }
    return unit * std::sqrt(square / n);
}

// Householder's C = Q R of the columns of f free polynomials in powers of seconds: R^-1, -R^-1 Q^T b_0, and what of b_0
// no z reaches.
inline void Planner::factor(std::int64_t f, const Powers &powers) {
    std::int64_t rows = columns, across = f + 6;
    double *a = m.matrix;  // (rows, f + 6): free columns, then those of the boundary
    double per_power = 1;
    for (std::int64_t r = 0; r < rows; ++r, per_power /= T)
        for (std::int64_t c = 0; c < across; ++c)
            a[r * across + c] = powers.columns[r * columns + (c < f ? 6 + c : c - f)] * per_power;
    for (std::int64_t c = 0; c < f; ++c) {
        double square = 0, largest = 0;
        for (std::int64_t r = c; r < rows; ++r) largest = larger(largest, std::fabs(a[r * across + c]));
        for (std::int64_t r = c; r < rows; ++r) {
            double part = a[r * across + c] / largest;
            square += part * part;
        }
        double length = std::copysign(largest * std::sqrt(square), a[c * across + c]);
        double head = a[c * across + c] + length;  // the reflection's vector is (1, a[r] / head)
        for (std::int64_t r = c + 1; r < rows; ++r) a[r * across + c] /= head;
        for (std::int64_t k = c + 1; k < across; ++k) {
            double part = a[c * across + k];
            for (std::int64_t r = c + 1; r < rows; ++r) part += a[r * across + c] * a[r * across + k];
            part *= head / length;
            a[c * across + k] -= part;
            for (std::int64_t r = c + 1; r < rows; ++r) a[r * across + k] -= part * a[r * across + c];
        }
        a[c * across + c] = -length;
    }
    double *rest = m.rest + f * columns * 6;
    for (std::int64_t r = f; r < rows; ++r) std::memcpy(rest + 6 * r, a + r * across + f, 6 * sizeof(double));
    double *inverse = m.scaling + f * width * width, *map = m.offset_map + f * width * 6;
    for (std::int64_t c = 0; c < f; ++c)
        for (std::int64_t r = f - 1; r >= 0; --r) {
            double rest = r == c;
            for (std::int64_t k = r + 1; k <= c; ++k) rest -= a[r * across + k] * inverse[k * f + c];
            inverse[r * f + c] = r > c ? 0 : rest / a[r * across + r];
        }
    for (std::int64_t r = 0; r < f; ++r)
        for (int c = 0; c < 6; ++c) {
            double part = 0;
            for (std::int64_t k = r; k < f; ++k) part -= inverse[r * f + k] * a[k * across + f + c];
            map[6 * r + c] = part;
        }
}

// Largest singular value of an upper triangular matrix (f, f), by the power method.
inline double Planner::norm(const double *matrix, std::int64_t f) const {
    double *v = m.matrix, *w = v + f, value = 0;
    for (std::int64_t k = 0; k < f; ++k) v[k] = 1;
    for (int step = 0; step < 200; ++step) {
        double square = 0, length = 0;
        for (std::int64_t r = 0; r < f; ++r) {
            w[r] = 0;
            for (std::int64_t c = r; c < f; ++c) w[r] += matrix[r * f + c] * v[c];
            square += w[r] * w[r];
        }
        for (std::int64_t k = 0; k < f; ++k) length += v[k] * v[k];
        double before = value;
        value = std::sqrt(square / length);
        if (std::fabs(value - before) <= 1e-14 * value) break;
        for (std::int64_t c = 0; c < f; ++c) {
            v[c] = 0;
            for (std::int64_t r = 0; r <= c; ++r) v[c] += matrix[r * f + c] * w[r];
            v[c] /= square;  // only against overflow
        }
    }
    return value;
}
