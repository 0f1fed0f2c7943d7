// Rotations as vectors of rotation and as three angles, see floatplan/motion/spatial/rotations.py.

// The vector of the shortest rotation, rad, by way of the quaternion.
static inline Vector3 logarithm(const Matrix3 &rotation) {
    double r[9], q[4];
    store(r, rotation);
    const double trace = r[0] + r[4] + r[8];
    int largest = 3;
    double most = trace;
    for (int i = 0; i < 3; ++i)
        if (r[4 * i] > most) {
            most = r[4 * i];
            largest = i;
        }
    if (largest == 3) {
        q[0] = r[7] - r[5];
        q[1] = r[2] - r[6];
        q[2] = r[3] - r[1];
        q[3] = 1 + trace;
    } else {
        const int i = largest, j = (i + 1) % 3, k = (j + 1) % 3;
        q[i] = 1 - trace + 2 * r[4 * i];
        q[j] = r[3 * j + i] + r[3 * i + j];
        q[k] = r[3 * k + i] + r[3 * i + k];
        q[3] = r[3 * k + j] - r[3 * j + k];
    }
    const double sign = q[3] < 0 ? -1 : 1;
    const Vector3 along = sign * vector3(q);
    const double sine = std::sqrt(dot(along, along)), angle = 2 * std::atan2(sine, sign * q[3]);
    const double length = std::sqrt(sine * sine + q[3] * q[3]);
    if (angle > 1e-3) return angle / sine * along;
    return (2 + angle * angle / 12) / length * along;  // of a small angle, to 1e-14 of it
}

// The rotation by a vector, rad.
static inline Matrix3 exponential(Vector3 rotation_vector) {
    const double half = std::sqrt(dot(rotation_vector, rotation_vector)) / 2;
    const double sine_ratio = half < 1e-3 ? 0.5 - half * half / 12 : std::sin(half) / (2 * half);  // to 1e-14
    double quaternion[4];
    store(quaternion, sine_ratio * rotation_vector);
    quaternion[3] = std::cos(half);
    return rotation(quaternion);
}

// How the vector of a rotation changes with a small turn that is done after it.
static inline Matrix3 left_jacobian_inverse(Vector3 rotation_vector) {
    const double angle = std::sqrt(dot(rotation_vector, rotation_vector)), half = angle / 2;
    const double factor = angle < 1e-3 ? 1.0 / 12 : (1 - half / std::tan(half)) / (angle * angle);
    const Matrix3 across = cross_matrix(rotation_vector);
    return multiple(1.0) - 0.5 * across + factor * (across * across);
}

// The angles with which R = R_a(first) R_b(second) R_c(third), about axes a, b, c, of which c may be a; the second is
// between -90 and 90 degrees where it is not, else between 0 and 180.
static inline Vector3 angles_about(const Index *axes, const Matrix3 &rotation) {
    double r[9];
    store(r, rotation);
    const Index a = axes[0], b = axes[1], last = 3 - a - b;
    const double sign = (b - a + 3) % 3 == 1 ? 1 : -1;  // whether a, b and the other one are right-handed
    auto at = [&](Index row, Index column) { return r[3 * row + column]; };
    if (axes[2] == a) {
        const double cosine = smaller(larger(at(a, a), -1), 1);
        return {std::atan2(at(b, a), -sign * at(last, a)), std::acos(cosine), std::atan2(at(a, b), sign * at(a, last))};
    }
    const double sine = smaller(larger(sign * at(a, last), -1), 1);
    return {std::atan2(-sign * at(b, last), at(last, last)), std::asin(sine), std::atan2(-sign * at(a, b), at(a, a))};
}

// Eigenvalues, and eigenvectors as rows, of a symmetric matrix (3, 3), which is overwritten: Jacobi's rotations.
static inline void eigenvectors(double *matrix, double *values, double *vectors) {
    for (int e = 0; e < 9; ++e) vectors[e] = e % 4 == 0;
    for (int sweep = 0; sweep < 12; ++sweep)
        for (int p = 0; p < 2; ++p)
            for (int q = p + 1; q < 3; ++q) {
                const double off = matrix[3 * p + q];
                if (off == 0) continue;
                const double ratio = (matrix[4 * q] - matrix[4 * p]) / (2 * off);
                const double tangent = (ratio < 0 ? -1 : 1) / (std::fabs(ratio) + std::sqrt(ratio * ratio + 1));
                const double cosine = 1 / std::sqrt(tangent * tangent + 1), sine = tangent * cosine;
                auto rotate = [&](double &one, double &other) {
                    const double before = one;
                    one = cosine * before - sine * other;
                    other = sine * before + cosine * other;
                };
                for (int k = 0; k < 3; ++k) rotate(matrix[3 * k + p], matrix[3 * k + q]);
                for (int k = 0; k < 3; ++k) rotate(matrix[3 * p + k], matrix[3 * q + k]);
                for (int k = 0; k < 3; ++k) rotate(vectors[3 * p + k], vectors[3 * q + k]);
            }
    for (int k = 0; k < 3; ++k) values[k] = matrix[4 * k];
}
