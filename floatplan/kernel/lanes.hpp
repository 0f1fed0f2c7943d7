// The same operation on several nodes at once.

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

using Bits = std::int64_t __attribute__((vector_size(8 * LANES)));

typedef Vector Anywhere __attribute__((aligned(8)));  // not only where a whole vector would begin

static inline Vector load(const double *from) { return *(const Anywhere *)from; }

static inline void store(double *to, Vector value) { *(Anywhere *)to = value; }

static inline double sum(Vector value) {
    double result = 0;
    for (int lane = 0; lane < LANES; ++lane) result += value[lane];
    return result;
}

static inline Vector select(Bits mask, Vector one, Vector other) {
    return (Vector)((mask & (Bits)one) | (~mask & (Bits)other));
}

// Sine and cosine to about 1e-16: Taylor polynomials after the nearest multiple of pi/2 is taken away.
__attribute__((always_inline)) static inline void sine_cosine(Vector x, Vector &sine, Vector &cosine) {
    constexpr double round_to_whole = 6755399441055744.0;  // 1.5 * 2^52
    Vector shifted = multiply_add(x, all(0.63661977236758134), all(round_to_whole));
    Vector whole = shifted - all(round_to_whole);
    Vector r = multiply_add(whole, all(-1.5707963267341256), x);  // pi/2 in three parts, the first two of 33 bits
    r = multiply_add(whole, all(-6.0771005063039660e-11), r);
    r = multiply_add(whole, all(-2.0222662487959506e-21), r);
    Vector r2 = r * r;
    Vector s = all(1 / 355687428096000.0);
    s = multiply_add(s, r2, all(-1 / 1307674368000.0));
    s = multiply_add(s, r2, all(1 / 6227020800.0));
    s = multiply_add(s, r2, all(-1 / 39916800.0));
    s = multiply_add(s, r2, all(1 / 362880.0));
    s = multiply_add(s, r2, all(-1 / 5040.0));
    s = multiply_add(s, r2, all(1 / 120.0));
    s = multiply_add(s, r2, all(-1 / 6.0));
    s = multiply_add(s * r2, r, r);
    Vector c = all(1 / 20922789888000.0);
    c = multiply_add(c, r2, all(-1 / 87178291200.0));
    c = multiply_add(c, r2, all(1 / 479001600.0));
    c = multiply_add(c, r2, all(-1 / 3628800.0));
    c = multiply_add(c, r2, all(1 / 40320.0));
    c = multiply_add(c, r2, all(-1 / 720.0));
    c = multiply_add(c, r2, all(1 / 24.0));
    c = multiply_add(c, r2, all(-0.5));
    c = multiply_add(c, r2, all(1.0));
    Bits quadrant = (Bits)shifted, odd = -(quadrant & 1);
    sine = (Vector)((Bits)select(odd, c, s) ^ ((quadrant & 2) << 62));
    cosine = (Vector)((Bits)select(odd, s, c) ^ (((quadrant + 1) & 2) << 62));
}
