// The same operation on several nodes at once.

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

typedef Vector Anywhere __attribute__((aligned(8)));  // not only where a whole vector would begin

static inline Vector load(const double *from) { return *(const Anywhere *)from; }

static inline void store(double *to, Vector value) { *(Anywhere *)to = value; }

static inline double sum(Vector value) {
    double part[LANES];
    store(part, value);
    for (int half = LANES / 2; half; half /= 2)
        for (int lane = 0; lane < half; ++lane) part[lane] += part[lane + half];
    return part[0];
}

static inline Vector select(Bits mask, Vector one, Vector other) {
    return (Vector)((mask & (Bits)one) | (~mask & (Bits)other));
}

static inline Vector larger(Vector a, Vector b) { return select(a > b, a, b); }
static inline Vector smaller(Vector a, Vector b) { return select(a < b, a, b); }
static inline Vector magnitude(Vector a) { return (Vector)((Bits)a & INT64_MAX); }

static inline double largest(Vector value) {  // of numbers that are not negative
    double most = 0;
    for (int lane = 0; lane < LANES; ++lane) most = larger(value[lane], most);
    return most;
}

// Dense algebra, in this order: what is the same sum is the same double.

static inline double dot(const double *a, const double *b, Index size, double result = 0) {
    for (Index k = 0; k < size; ++k) result += a[k] * b[k];
    return result;
}

static inline void add(double factor, const double *values, Index size, double *result) {
    Index k = 0;
    for (; k + LANES <= size; k += LANES) store(result + k, load(result + k) + all(factor) * load(values + k));
    for (; k < size; ++k) result[k] += factor * values[k];
}

// The same of as many numbers as whole vectors hold, several sums side by side.
static inline double dot_of_vectors(const double *a, const double *b, Eights size) {
    Vector result = all(0);
    for (Index k = 0; k < size; k += LANES) result = multiply_add(load(a + k), load(b + k), result);
    return sum(result);
}

static inline void zero(double *values, Index size) { std::memset(values, 0, size * sizeof(double)); }
static inline void copy(double *to, const double *from, Index size) { std::memcpy(to, from, size * sizeof(double)); }

// left (rows, inner) times right (inner, columns); sums over rows of `right` first, so that they are vectorised.
static inline void multiply(const double *left, Index rows, Index inner, const double *right, Index columns,
                            double *result) {
    zero(result, rows * columns);
    for (Index r = 0; r < rows; ++r)
        for (Index k = 0; k < inner; ++k) add(left[r * inner + k], right + k * columns, columns, result + r * columns);
}

// Sums dot(row, vector) of rows (rows, inner) that begin so far apart: of several rows side by side, as each waits for itself.
static inline void multiply_vector(const double *matrix, Index rows, Index inner, Index apart, const double *vector,
                                   double *result) {
    constexpr Index side_by_side = 8;
    Index r = 0;
    for (; r + side_by_side <= rows; r += side_by_side, matrix += side_by_side * apart) {
        double sums[side_by_side] = {};
        for (Index k = 0; k < inner; ++k)
            for (Index own = 0; own < side_by_side; ++own) sums[own] += matrix[own * apart + k] * vector[k];
        copy(result + r, sums, side_by_side);
    }
    for (; r < rows; ++r, matrix += apart) result[r] = dot(matrix, vector, inner);
}

// Sine and cosine to about 1e-16, after the nearest multiple of pi/2 is taken away: the polynomials of FDLIBM's k_sin.c
// and k_cos.c (Sun Microsystems 1993).
INLINED void sine_cosine(Vector x, Vector &sine, Vector &cosine) {
    constexpr double round_to_whole = 6755399441055744.0;  // 1.5 * 2^52
    Vector shifted = multiply_add(x, all(0.63661977236758134), all(round_to_whole));
    Vector whole = shifted - all(round_to_whole);
    Vector r = multiply_add(whole, all(-1.5707963267341256), x);  // pi/2 in three parts, the first two of 33 bits
    r = multiply_add(whole, all(-6.0771005063039660e-11), r);
    r = multiply_add(whole, all(-2.0222662487959506e-21), r);
    Vector r2 = r * r;
    Vector s = all(1.58969099521155010221e-10);
    s = multiply_add(s, r2, all(-2.50507602534068634195e-8));
    s = multiply_add(s, r2, all(2.75573137070700676789e-6));
    s = multiply_add(s, r2, all(-1.98412698298579493134e-4));
    s = multiply_add(s, r2, all(8.33333333332248946124e-3));
    s = multiply_add(s, r2, all(-1.66666666666666324348e-1));
    s = multiply_add(s * r2, r, r);
    Vector c = all(-1.13596475577881948265e-11);
    c = multiply_add(c, r2, all(2.08757232129817482790e-9));
    c = multiply_add(c, r2, all(-2.75573143513906633035e-7));
    c = multiply_add(c, r2, all(2.48015872894767294178e-5));
    c = multiply_add(c, r2, all(-1.38888888888741095749e-3));
    c = multiply_add(c, r2, all(4.16666666666666019037e-2));
    c = multiply_add(c, r2, all(-0.5));
    c = multiply_add(c, r2, all(1.0));
    Bits quadrant = (Bits)shifted, odd = -(quadrant & 1);
    sine = (Vector)((Bits)select(odd, c, s) ^ ((quadrant & 2) << 62));
    cosine = (Vector)((Bits)select(odd, s, c) ^ (((quadrant + 1) & 2) << 62));
}
