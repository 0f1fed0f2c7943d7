// The elastic step of the SQP, where the linearised constraints contradict one another: each of them gives a little.
//
//     minimise  g d + d H d / 2 + rho / 2 (sum_e (c_e + a_e d)^2 + sum_i min(0, v_i + s_i d)^2)
//
// with equalities c, rows of values v, their derivatives a and s, and a penalty rho: a quadratic penalty (Nocedal and Wright,
// section 17.1) in place of the constraints. It is convex and quadratic piece by piece, so Newton's method on the rows that
// are violated, each step as far as the function falls, ends at its minimum once the violated rows stay the same. The
// multipliers of the step are rho (c_e + a_e d) and -rho min(0, v_i + s_i d).

template <typename Flight> void Sqp<Flight>::find_elastic_step() {
    const double penalty = slack_penalty;
    program.differentiate_rows(*now, exchange.reach);
    gather(*now);
    double lacking[MOST];  // c_e + a_e d
    copy(lacking, now->equality, MOST);
    zero(direction, size);
    copy(linear, gathered, near());
    for (Index iteration = 0; iteration < exchange.elastic_iterations; ++iteration) {
        copy(matrix, hessian, size * size);
        for (Index k = 0; k < size; ++k) {
            right[k] = -dot(hessian + k * size, direction, size, now->gradient[k]);
            matrix[k * size + k] += exchange.regularisation * penalty;
        }
        copy(product, right, size);
        for (Index e = 0; e < program.equalities; ++e) add_normal(row_of(e), penalty, lacking[e]);
        add_violated(penalty);
        program.work += exchange.solving * (size * size * size / 3 + near() * size);
        copy(change, right, size);
        if (!eliminate(matrix, change, size)) break;
        follow(change, slope);
        const double length = find_lowest(penalty, lacking);
        bool is_last = length == 1;  // a whole step, that changes which rows are violated nowhere
        for (Index e = 0; e < near(); ++e) {
            const double value = linear[e] + length * slope[e];
            is_last &= (value < 0) == (linear[e] < 0);
            linear[e] = value;
        }
        add(length, change, size, direction);
        for (Index e = 0; e < program.equalities; ++e)
            lacking[e] = now->equality[e] + dot(row_of(e), direction, size);
        if (is_last || !(length > 0)) break;
    }
    violation_left = 0;
    for (Index e = 0; e < program.equalities; ++e) {
        step_equality_multipliers[e] = penalty * lacking[e];
        violation_left += std::fabs(lacking[e]);
    }
    step_count = 0;
    for (Index e = 0; e < near(); ++e) {
        if (!(linear[e] < 0)) continue;
        violation_left -= linear[e];
        step_active[step_count] = entry(e);
        step_multipliers[step_count++] = -penalty * linear[e];
    }
}

// Adds the normal equations of the rows that are violated after a step, several rows at once: the lower triangle of
// s_i s_i^T and v_i s_i are summed up in `squares_of_rows` one after the other, a vector each.
template <typename Flight> void Sqp<Flight>::add_violated(double weight) {
    zero(squares_of_rows, size * (size + 3) / 2 * LANES);
    for (Index e = 0; e < near(); e += LANES) {
        const Bits violated = load(linear + e) < all(0);
        if (!any(violated)) continue;
        program.work += exchange.solving * LANES * size * size / 2;
        const double *slopes = now->slopes + e / 8 * size * 8 + e % 8;
        const Vector value = select(violated, load(linear + e), all(0));
        Vector *sum = (Vector *)squares_of_rows;
        for (Index a = 0; a < size; ++a) {
            const Vector own = select(violated, load(slopes + 8 * a), all(0));
            for (Index b = 0; b <= a; ++b, ++sum) *sum = multiply_add(own, load(slopes + 8 * b), *sum);
            *sum = multiply_add(own, value, *sum);
            ++sum;
        }
    }
    const Vector *summed = (const Vector *)squares_of_rows;
    for (Index a = 0; a < size; ++a) {
        for (Index b = 0; b <= a; ++b, ++summed) {
            const double part = weight * sum(*summed);
            matrix[a * size + b] += part;
            if (b < a) matrix[b * size + a] += part;
        }
        right[a] -= weight * sum(*summed);
        ++summed;
    }
}

// How far along `change` the elastic program falls, nearly: 1 where that is so, else between two lengths where its slope has
// other signs, by secants (the Illinois method: the end that stays counts half). Without penalties the slope is -product.
template <typename Flight> double Sqp<Flight>::find_lowest(double penalty, const double *lacking) {
    constexpr double enough = 0.1;     // [-] of the slope at the begin: a tenth of it is hardly worth another evaluation
    constexpr Index most_steps = 40;
    double curvature = 0, slope_at_begin = 0;
    for (Index e = 0; e < program.equalities; ++e) {
        const double along = dot(row_of(e), change, size);
        curvature += penalty * along * along;
        slope_at_begin += penalty * along * lacking[e];
    }
    for (Index k = 0; k < size; ++k) curvature += change[k] * dot(hessian + k * size, change, size);
    slope_at_begin -= dot(product, change, size);
    const auto slope_at = [&](double length) {
        Vector rows = all(0);
        for (Index e = 0; e < near(); e += LANES) {
            const Vector by = load(slope + e);
            const Vector value = load(linear + e) + all(length) * by;
            rows += select(value < all(0), value * by, all(0));
        }
        return slope_at_begin + length * curvature + penalty * sum(rows);
    };
    double low = 0, high = 1, length = 1;
    double slope_at_low = slope_at(0), slope_at_high = slope_at(1), current = slope_at_high;
    const double small = enough * std::fabs(slope_at_low);
    for (Index steps = 0; steps < most_steps && std::fabs(current) > small; ++steps) {
        if (current < 0 && length == high) {  // it falls beyond the farther end: that moves on
            low = high;
            slope_at_low = current;
            high = length = 2 * high;
            current = slope_at_high = slope_at(high);
            continue;
        }
        length = low - slope_at_low * (high - low) / (slope_at_high - slope_at_low);
        current = slope_at(length);
        if (current < 0) {
            low = length;
            slope_at_low = current;
            slope_at_high /= 2;
        } else {
            high = length;
            slope_at_high = current;
            slope_at_low /= 2;
        }
    }
    return std::isfinite(length) ? length : 0;
}
