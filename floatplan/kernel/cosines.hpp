// Lower bounds of sums of cosines on boxes; see TrigonometricPolynomial of floatplan/motion/planar/bounds.py.

// Raises a box's bound to the better one of the sum of the cosines' own least values and the second-order Taylor bound
// about its centre; returns the value there.
static inline double raise_bound(const Cosines &of, double *box) {
    constexpr double round_to_whole = 6755399441055744.0, pi = 3.141592653589793;  // 1.5 * 2^52
    const Index n = of.joints;
    const double *centre = box, *half_width = box + n;
    Vector values = all(0), lowest = all(0), bent = all(0), sine, cosine;
    for (Index l = 0; l < of.terms; l += LANES) {
        Vector argument = load(of.phase + l), reach = all(0);
        for (Index j = 0; j < n; ++j) {
            const Vector frequency = load(of.frequency + j * of.terms + l);
            argument = multiply_add(all(centre[j]), frequency, argument);
            reach = multiply_add(all(half_width[j]), magnitude(frequency), reach);
        }
        const Vector amplitude = load(of.amplitude + l);
        sine_cosine(argument, sine, cosine);
        store(of.pulls + l, amplitude * sine);
        values = multiply_add(amplitude, cosine, values);
        bent = multiply_add(amplitude * reach, reach * 0.5, bent);
        const Vector turns = (argument * (0.5 / pi) + round_to_whole) - round_to_whole;
        const Vector to_pi = pi - magnitude(argument - 2 * pi * turns);
        sine_cosine(larger(to_pi - reach, all(0)), sine, cosine);
        lowest = multiply_add(amplitude, cosine, lowest);
    }
    const double value = of.constant + sum(values);
    double taylor = value - sum(bent);
    for (Index j = 0; j < n; ++j) {
        Vector slope = all(0);
        for (Index l = 0; l < of.terms; l += LANES)
            slope = multiply_add(load(of.pulls + l), load(of.frequency + j * of.terms + l), slope);
        taylor -= std::fabs(sum(slope)) * half_width[j];
    }
    box[2 * n] = larger(box[2 * n], larger(of.constant - sum(lowest), taylor));
    return value;
}

// Bounds boxes, or both halves of each, cut across the joint that moves the sum most.
Index bound_boxes(const Cosines &of) {
    const Index n = of.joints, size = 2 * n + 1;
    for (Index k = 0; k < of.count; ++k) {
        double *low = of.parts + k * size, *high = low + of.count * size;
        copy(low, of.boxes + k * size, size);
        if (of.cuts) {
            Index cut = 0;
            for (Index j = 1; j < n; ++j)
                if (low[n + j] * of.influence[j] > low[n + cut] * of.influence[cut]) cut = j;
            low[n + cut] /= 2;
            copy(high, low, size);
            low[cut] -= low[n + cut];
            high[cut] += low[n + cut];
            of.value[of.count + k] = raise_bound(of, high);
        }
        of.value[k] = raise_bound(of, low);
    }
    return 0;
}
