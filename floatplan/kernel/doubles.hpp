// Sums of two doubles, for coefficients in powers of seconds.

struct Double2 {
    double high, low;
    Double2(double high = 0, double low = 0) : high(high), low(low) {}
};

static inline Double2 quick_sum(double a, double b) {  // |a| >= |b|
    double s = a + b;
    return {s, b - (s - a)};
}

static inline Double2 exact_sum(double a, double b) {
    double s = a + b, t = s - a;
    return {s, (a - (s - t)) + (b - t)};
}

static inline double upper_half(double a) {
    std::uint64_t bits;
    std::memcpy(&bits, &a, sizeof bits);
    bits &= ~std::uint64_t{0x7ffffff};
    std::memcpy(&a, &bits, sizeof bits);
    return a;
}

static inline Double2 exact_product(double a, double b) {
    if (FUSED) return {a * b, __builtin_fma(a, b, -(a * b))};
    double p = a * b, ah = upper_half(a), al = a - ah, bh = upper_half(b), bl = b - bh;
    return {p, ((ah * bh - p) + ah * bl + al * bh) + al * bl};
}

static inline Double2 operator+(Double2 a, Double2 b) {
    Double2 s = exact_sum(a.high, b.high), t = exact_sum(a.low, b.low);
    s = quick_sum(s.high, s.low + t.high);
    return quick_sum(s.high, s.low + t.low);
}

static inline Double2 operator*(Double2 a, Double2 b) {
    Double2 p = exact_product(a.high, b.high);
    return quick_sum(p.high, p.low + (a.high * b.low + a.low * b.high));
}

static inline double quotient(Double2 a, Double2 b) {  // correctly rounded but for near ties
    double first = a.high / b.high;
    Double2 rest = a + b * -first;
    return first + (rest.high + rest.low) / b.high;
}

// Coefficients b (columns) in powers of seconds of a combination of the basis, see powers_of_seconds() of
// floatplan/motion/exact_polynomials.py.
static inline void write_coefficients(const double *combination, const Double2 *time, const Powers &powers,
                                      Index columns, double *b) {
    Double2 rest[MOST_COLUMNS];
    for (Index c = 0; c < columns; ++c) {  // powers within: none of their sums waits for another
        if (combination[c] == 0) continue;
        for (Index k = 0; k < columns; ++k) {
            double high = powers.columns[k * columns + c];
            if (high != 0) rest[k] = rest[k] + Double2{high, powers.columns_low[k * columns + c]} * combination[c];
        }
    }
    for (Index k = columns - 1; k >= 0; --k) {
        b[k] = quotient(rest[k], time[k]);
        Double2 rounding = rest[k] + time[k] * -b[k];
        for (Index index = 0; index < k; ++index) {
            double high = powers.lost[k * columns + index];
            if (high != 0)
                rest[index] = rest[index] + rounding * Double2{-high, -powers.lost_low[k * columns + index]};
        }
    }
}
