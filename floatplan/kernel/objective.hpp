// What a flight's program minimises, its gradient, and a first guess of the Lagrangian's Hessian. Either half of (17),
//
//     |b|^2 / 2,
//
// where x are whitened |x|^2 / 2 but for a constant, and else by the map from the basis to b; or the integral over the flight
// of the squares of some sums u_i (torques, rates, accelerations), in units of what the plain motion needs of it,
//
//     T / scale * sum_k w_k sum_i u_i(s_k)^2,
//
// by the weights w of the nodes. Its Hessian is guessed as by Gauss and Newton, 2 T / scale sum_k w_k sum_i u_i' u_i'^T
// (Nocedal and Wright, section 10.3), and a little of the largest entry is added, that it be definite.

template <typename Flight> double Program<Flight>::objective(const At &at) {
    if (!problem.objective_sums && !motions.map) return dot(at.x, at.x, free) / 2;
    if (!problem.objective_sums) {
        multiply(motions.map, motions.terms, motions.columns, at.coefficients, n, written);
        return dot(written, written, motions.terms * n) / 2;
    }
    Vector total = all(0);
    for (Index number = 0; number < problem.objective_sums; ++number) {
        double *used = at.used + number * stride;
        flight.write_sum(at.motion, at.state, problem.objective_sum + number, used);
        for (Index k = 0; k < nodes(); k += LANES)
            total = multiply_add(load(levels[level].weights + k) * load(used + k), load(used + k), total);
    }
    return motions.duration / problem.objective_scale * sum(total);
}

// Its gradient.
template <typename Flight> void Program<Flight>::differentiate_objective(At &at) {
    zero(at.gradient, size);
    if (!problem.objective_sums && !motions.map) return copy(at.gradient, at.x, free);
    if (!problem.objective_sums) {
        double *b = written + motions.terms * n;
        multiply(motions.map, motions.terms, motions.columns, at.coefficients, n, b);
        each_slope_of_b([&](Index entry) { add(b[entry], slope, size, at.gradient); });
        return;
    }
    const Index terms = flight.terms();
    const Vector scale = all(2 * motions.duration / problem.objective_scale);
    Vector *of_terms = (Vector *)weights;
    zero(pack, 8 * size);
    for (Index k = 0; k < nodes(); k += LANES) {
        const Vector weight = scale * load(levels[level].weights + k);
        for (Index term = 0; term < terms; ++term) of_terms[term] = all(0);
        for (Index number = 0; number < problem.objective_sums; ++number) {
            const double *own = constraints.sums + (problem.objective_sum + number) * terms;
            const Vector used = weight * load(at.used + number * stride + k);
            for (Index term = 0; term < terms; ++term) of_terms[term] = add_product(own[term], used, of_terms[term]);
        }
        flight.add_sum_slopes(at.motion, at.state, at.variables, k, of_terms, pack);
    }
    for (Index c = 0; c < size; ++c) at.gradient[c] = sum(load(pack + 8 * c));
}

// Adds its Hessian (size, size), as by Gauss and Newton.
template <typename Flight> void Program<Flight>::add_gauss_newton(At &at, double *hessian) {
    if (!problem.objective_sums) {
        each_slope_of_b([&](Index) {
            for (Index a = 0; a < size; ++a) add(slope[a], slope, size, hessian + a * size);
        });
        return;
    }
    const Index terms = flight.terms();
    const Vector scale = all(2 * motions.duration / problem.objective_scale);
    Vector *of_terms = (Vector *)weights;
    for (Index k = 0; k < nodes(); k += LANES) {
        const Vector weight = scale * load(levels[level].weights + k);
        for (Index number = 0; number < problem.objective_sums; ++number) {
            const double *own = constraints.sums + (problem.objective_sum + number) * terms;
            for (Index term = 0; term < terms; ++term) of_terms[term] = all(own[term]);
            zero(pack, 8 * size);
            flight.add_sum_slopes(at.motion, at.state, at.variables, k, of_terms, pack);
            add_normals(weight, hessian);
        }
    }
}

// Squares of the derivatives at the instants that are computed at once, times weights.
template <typename Flight> void Program<Flight>::add_normals(Vector weight, double *hessian) const {
    for (Index a = 0; a < size; ++a)
        for (Index b = 0; b <= a; ++b) {
            const double part = sum(weight * load(pack + 8 * a) * load(pack + 8 * b));
            hessian[a * size + b] += part;
            if (b < a) hessian[b * size + a] += part;
        }
}

// Calls with each entry of b, whose derivatives (size) by x are in `slope` then, where the conditions (13) follow h.
template <typename Flight> template <typename Visit> void Program<Flight>::each_slope_of_b(Visit visit) {
    const double *by_axis = boundary + n * motions.fixed_columns;
    for (Index term = 0; term < motions.terms; ++term)
        for (Index i = 0; i < n; ++i) {
            const double *map = motions.map + term * motions.columns;
            const Index begin = motions.first[i], end = motions.first[i + 1];
            zero(slope, size);
            for (Index r = begin; r < end; ++r)
                add(map[motions.fixed_columns + r - begin], motions.scaling + r * free + begin, end - begin, slope + begin);
            slope[free] = dot(map, by_axis + i * motions.fixed_columns, motions.fixed_columns);
            visit(term * n + i);
        }
}

// A positive definite first guess (size, size) of the Lagrangian's Hessian.
template <typename Flight> void Program<Flight>::guess_hessian(At &at, double *hessian) {
    differentiate(at);
    zero(hessian, size * size);
    if (!problem.objective_sums && !motions.map) {
        for (Index a = 0; a < size; ++a) hessian[a * size + a] = a < free ? 1 : exchange.momentum_curvature;
        return;
    }
    add_gauss_newton(at, hessian);
    double most = 0;
    for (Index a = 0; a < size; ++a) most = larger(most, hessian[a * size + a]);
    const double lowest_curvature = problem.objective_sums ? exchange.least_curvature * larger(most, exchange.least_curvature) : 0;
    for (Index a = 0; a < size; ++a) hessian[a * size + a] += motions.map ? a >= free : lowest_curvature;
}
