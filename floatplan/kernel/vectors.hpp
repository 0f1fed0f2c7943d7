// Vectors and matrices of space, at one instant (Number is double) or at several at once (Vector); matrices by rows.

template <typename Number> static inline Number number(double value);
template <> inline double number<double>(double value) { return value; }
template <> inline Vector number<Vector>(double value) { return all(value); }

template <typename Number> struct Triple {
    Number x, y, z;
};
#define OF_NUMBER template <typename Number> static inline
OF_NUMBER Triple<Number> operator+(Triple<Number> a, Triple<Number> b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
OF_NUMBER Triple<Number> operator-(Triple<Number> a, Triple<Number> b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
OF_NUMBER Triple<Number> operator*(Number s, Triple<Number> a) { return {s * a.x, s * a.y, s * a.z}; }
OF_NUMBER Triple<Number> operator-(Triple<Number> a) { return {-a.x, -a.y, -a.z}; }
OF_NUMBER Number dot(Triple<Number> a, Triple<Number> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
OF_NUMBER Triple<Number> cross(Triple<Number> a, Triple<Number> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
OF_NUMBER Triple<Number> triple(const double *from) {
    return {number<Number>(from[0]), number<Number>(from[1]), number<Number>(from[2])};
}

template <typename Number> struct Square {
    Triple<Number> row[3];
};
OF_NUMBER Square<Number> operator+(const Square<Number> &a, const Square<Number> &b) {
    return {{a.row[0] + b.row[0], a.row[1] + b.row[1], a.row[2] + b.row[2]}};
}
OF_NUMBER Square<Number> operator-(const Square<Number> &a, const Square<Number> &b) {
    return {{a.row[0] - b.row[0], a.row[1] - b.row[1], a.row[2] - b.row[2]}};
}
OF_NUMBER Square<Number> operator*(Number s, const Square<Number> &a) {
    return {{s * a.row[0], s * a.row[1], s * a.row[2]}};
}
OF_NUMBER Triple<Number> operator*(const Square<Number> &a, Triple<Number> b) {
    return {dot(a.row[0], b), dot(a.row[1], b), dot(a.row[2], b)};
}
OF_NUMBER Triple<Number> operator*(Triple<Number> b, const Square<Number> &a) {
    return b.x * a.row[0] + b.y * a.row[1] + b.z * a.row[2];
}
OF_NUMBER Square<Number> operator*(const Square<Number> &a, const Square<Number> &b) {
    return {{a.row[0] * b, a.row[1] * b, a.row[2] * b}};
}
OF_NUMBER Square<Number> transposed(const Square<Number> &a) {
    return {{{a.row[0].x, a.row[1].x, a.row[2].x}, {a.row[0].y, a.row[1].y, a.row[2].y},
             {a.row[0].z, a.row[1].z, a.row[2].z}}};
}
OF_NUMBER Square<Number> multiple(Number s) {
    const Number none = number<Number>(0);
    return {{{s, none, none}, {none, s, none}, {none, none, s}}};
}
OF_NUMBER Square<Number> outer(Triple<Number> a, Triple<Number> b) { return {{a.x * b, a.y * b, a.z * b}}; }
OF_NUMBER Square<Number> cross_matrix(Triple<Number> a) {
    const Number none = number<Number>(0);
    return {{{none, -a.z, a.y}, {a.z, none, -a.x}, {-a.y, a.x, none}}};
}
OF_NUMBER Square<Number> less_than_trace(const Square<Number> &a) {  // tr(a) 1 - a
    return multiple(a.row[0].x + a.row[1].y + a.row[2].z) - a;
}
OF_NUMBER Square<Number> inverse(const Square<Number> &a) {
    const Triple<Number> x = cross(a.row[1], a.row[2]), y = cross(a.row[2], a.row[0]), z = cross(a.row[0], a.row[1]);
    return number<Number>(1) / dot(a.row[0], x) * transposed(Square<Number>{{x, y, z}});
}
OF_NUMBER Square<Number> square(const double *from) {
    return {{triple<Number>(from), triple<Number>(from + 3), triple<Number>(from + 6)}};
}

// What moves (linear: of the point at the origin), or a force (angular: its moment about the origin).
template <typename Number> struct Spatial {
    Triple<Number> linear, angular;
};
OF_NUMBER Spatial<Number> operator+(Spatial<Number> a, Spatial<Number> b) {
    return {a.linear + b.linear, a.angular + b.angular};
}
OF_NUMBER Spatial<Number> operator*(Number s, Spatial<Number> a) { return {s * a.linear, s * a.angular}; }
OF_NUMBER Number dot(Spatial<Number> a, Spatial<Number> b) { return dot(a.linear, b.linear) + dot(a.angular, b.angular); }
OF_NUMBER Spatial<Number> cross(Spatial<Number> v, Spatial<Number> moving) {
    return {cross(v.angular, moving.linear) + cross(v.linear, moving.angular), cross(v.angular, moving.angular)};
}
OF_NUMBER Spatial<Number> cross_force(Spatial<Number> v, Spatial<Number> force) {
    return {cross(v.angular, force.linear), cross(v.angular, force.angular) + cross(v.linear, force.linear)};
}

// The same of one instant, and where it is kept.
using Vector3 = Triple<double>;
using Matrix3 = Square<double>;
static inline Vector3 vector3(const double *from) { return triple<double>(from); }
static inline Matrix3 matrix3(const double *from) { return square<double>(from); }
static inline void store(double *to, Vector3 a) { to[0] = a.x, to[1] = a.y, to[2] = a.z; }
static inline void store(double *to, const Matrix3 &a) {
    for (int i = 0; i < 3; ++i) store(to + 3 * i, a.row[i]);
}

// Of a quaternion of any length, its part along the axis first.
OF_NUMBER Square<Number> rotation(Triple<Number> along, Number w) {
    const Number square = dot(along, along) + w * w, two = number<Number>(2);
    const Square<Number> across = cross_matrix(along);
    return multiple(number<Number>(1)) + (two * w / square) * across + (two / square) * (across * across);
}
static inline Matrix3 rotation(const double *quaternion) { return rotation(vector3(quaternion), quaternion[3]); }
