// The correction with the least sum of miss at the landing, change of the accelerations, and breach of limits, softly.
// With the miss c, the change y of the motion and the rows g of the limits that are near, each of one instant, a few
// Gauss-Newton steps on
//
//     c^2 / sigma^2 + |y|^2 / (a^2 tau^4) + sum_j min(g_j - aim_j, 0)^2 / softness_j^2,
//
// tau the time that remains. The second term makes the last corrections fade: what is left to correct and the time for
// it both go to zero, and the minimal-norm correction's torque would grow like 1 / tau^2.

class Correcting {
  public:
    Correcting(const Flight &flight, RestOfFlight &rest, std::int64_t joints)
        : f(flight), rest(rest), n(joints), width(f.width), size(n * width) {}

    void lay_out(Arena &arena) {
        const std::int64_t most = 1 + f.law.most_rows * f.blocks;
        for (double **each : {&best, &y, &step}) arena.take(*each, size);
        arena.take(hessian, size * size);
        arena.take(jacobian, most * size);
        arena.take(residual, most);
        arena.take(first, (6 + width) * n);
        arena.take(worst, f.blocks);
        for (Predicted *each : {present, tried}) rest.lay_out(arena, *each);
    }

    // What comes of a motion as it is.
    void predict(const double *coefficients, Corrected &found) {
        std::memcpy(present->coefficients, coefficients, (6 + width) * n * sizeof(double));
        rest.evaluate(*present);
        found.share = found.evaluated = 1;
        std::memcpy(f.row_values, present->value, f.block_first[f.blocks] * f.instants * sizeof(double));
        report(found);
    }

    // Corrects the motion whose coefficients are given; leaves the new ones, and what comes of them, in `f`.
    void correct(const double *coefficients, std::int64_t evaluations, Corrected &found) {
        std::memcpy(first, coefficients, (6 + width) * n * sizeof(double));
        std::memcpy(present->coefficients, coefficients, (6 + width) * n * sizeof(double));
        rest.evaluate(*present);
        std::memcpy(worst, present->worst, f.blocks * sizeof(double));
        found.evaluated = 1;
        const bool warm = f.is_warm && warm_start(found);
        const double missed = present->miss;
        const bool far = f.blocks && std::fabs(missed) > f.law.far;
        if (far) evaluations = evaluations > f.law.evaluations_far ? evaluations : f.law.evaluations_far;
        const bool landed = far && rest.has_distances && solve_as_landed(evaluations, missed, found);
        if (far && rest.has_distances) evaluations = f.law.evaluations_near;
        if (!landed) solve(evaluations, found);
        found.share = 1;
        if (!landed && !keeps(*present)) {
            std::memcpy(y, best, size * sizeof(double));
            found.share = 0;
            for (double scale : {f.law.scales[0], f.law.scales[1]}) {
                for (std::int64_t k = 0; k < size; ++k) step[k] = scale * y[k];
                change(*tried, step, found);
                if (!keeps(*tried) || !(std::fabs(tried->miss) < std::fabs(missed))) continue;
                found.share = scale;
                std::memcpy(best, step, size * sizeof(double));
                std::swap(present, tried);
                break;
            }
            if (found.share == 0) {
                for (std::int64_t k = 0; k < size; ++k) best[k] = 0;
                change(*present, best, found);
                found.share = warm;
            }
        }
        std::memcpy(f.coefficients, present->coefficients, (6 + width) * n * sizeof(double));
        report(found);
    }

  private:
    const Flight &f;
    RestOfFlight &rest;
    Predicted two[2] = {}, *present = two, *tried = two + 1;
    std::int64_t n, width, size, rows = 0;
    double stiffness = 0, expected = 0;
    double *best, *y, *step, *hessian, *jacobian, *residual, *first, *worst;

    void report(Corrected &found) {
        found.miss = present->miss;
        std::memcpy(f.worst, present->worst, f.blocks * sizeof(double));
        rest.find_torque_peaks(*present);
    }

    // Begins at the motion that is prepared, where that lands nearer; what is left is corrected from there.
    bool warm_start(Corrected &found) {
        std::memcpy(tried->coefficients, first, (6 + width) * n * sizeof(double));
        for (std::int64_t k = 0; k < size; ++k) tried->coefficients[6 * n + k] += f.warm_start[k];
        rest.evaluate(*tried);
        ++found.evaluated;
        if (!(std::fabs(tried->miss) < smaller(std::fabs(present->miss), f.law.far) && keeps(*tried))) return false;
        std::swap(present, tried);
        std::memcpy(first, present->coefficients, (6 + width) * n * sizeof(double));
        std::memcpy(worst, present->worst, f.blocks * sizeof(double));
        return true;
    }

    // With distances as if the base were to reach the goal, so that feet in the ground do not keep it from turning
    // there; false, and back at the first motion, where it is no nearer then or something is broken.
    bool solve_as_landed(std::int64_t evaluations, double missed, Corrected &found) {
        rest.landed = true;
        rest.evaluate(*present);
        solve(evaluations, found);
        rest.landed = false;
        rest.evaluate(*present);
        found.evaluated += 2;
        if (std::fabs(present->miss) < std::fabs(missed) && keeps(*present)) return true;
        std::memcpy(present->coefficients, first, (6 + width) * n * sizeof(double));
        rest.evaluate(*present);
        return false;
    }

    bool keeps(const Predicted &a) const {
        for (std::int64_t b = 0; b < f.blocks; ++b)
            if (!(a.worst[b] >= -f.law.kept || worst[b] < -f.law.kept)) return false;
        return true;
    }

    void change(Predicted &a, const double *by, Corrected &found) const {
        for (std::int64_t c = 0; c < 6 + width; ++c)
            for (std::int64_t i = 0; i < n; ++i) {
                double part = 0;
                if (c >= 6)
                    for (std::int64_t k = 0; k < width; ++k)
                        part += f.whitening[(c - 6) * width + k] * by[i * width + k];
                a.coefficients[c * n + i] = first[c * n + i] + part / f.amplitude[i];
            }
        rest.evaluate(a);
        ++found.evaluated;
    }

    double tolerance(double miss) const {
        return f.blocks ? larger(f.sigma, std::fabs(miss) / f.law.weighed) : f.sigma;
    }

    double cost(const Predicted &a, const double *of, double sigma) const {
        double length = 0, part = a.miss / sigma;
        for (std::int64_t k = 0; k < size; ++k) length += of[k] * of[k];
        return part * part + stiffness * length + a.square;
    }

    // Gauss-Newton steps from the present motion, which is left the best one, changed by `best`.
    void solve(std::int64_t evaluations, Corrected &found) {
        const double enough = f.law.settled * f.law.settled, square = f.acceleration * rest.T * rest.T;
        stiffness = 1 / (square * square);
        for (std::int64_t k = 0; k < size; ++k) best[k] = 0;
        double sigma = tolerance(present->miss), least = cost(*present, best, sigma);
        next_step(sigma);
        for (std::int64_t number = 0; number < evaluations; ++number) {
            if (least - expected < enough) break;
            for (std::int64_t k = 0; k < size; ++k) y[k] = best[k] + step[k];
            change(*tried, y, found);
            double now = cost(*tried, y, sigma);
            if (!(now < least)) {
                double moved = 0;
                for (std::int64_t k = 0; k < size; ++k) step[k] *= f.law.shorter, moved += step[k] * step[k];
                if (!std::isfinite(now) || stiffness * moved < enough) break;
                continue;
            }
            bool settled = now - expected <= f.law.settled * now + enough;
            std::memcpy(best, y, size * sizeof(double));
            std::swap(present, tried);
            double nearer = tolerance(present->miss);
            if (settled && nearer > sigma / 2) break;
            sigma = nearer;
            least = cost(*present, best, sigma);
            if (number + 1 < evaluations) next_step(sigma);
        }
    }

    // The step, and the cost that it would have if everything were linear.
    void next_step(double sigma) {
        rest.differentiate_miss(*present, jacobian);
        for (std::int64_t k = 0; k < size; ++k) jacobian[k] /= sigma;
        residual[0] = present->miss / sigma;
        rows = 1;
        for (std::int64_t block = 0; block < f.blocks; ++block) gather(block);
        if (rows == 1) step_along_miss();
        else step_along_all();
        expected = 0;
        for (std::int64_t r = 0; r < rows; ++r) {
            double left = residual[r];
            for (std::int64_t a = 0; a < size; ++a) left += jacobian[r * size + a] * step[a];
            expected += left * left;
        }
        for (std::int64_t a = 0; a < size; ++a) expected += stiffness * (best[a] + step[a]) * (best[a] + step[a]);
    }

    // No limit is near: in closed form.
    void step_along_miss() {
        double along = 0, square = 0;
        for (std::int64_t a = 0; a < size; ++a) along += jacobian[a] * best[a], square += jacobian[a] * jacobian[a];
        const double share = (along - residual[0]) / (stiffness + square);
        for (std::int64_t a = 0; a < size; ++a) step[a] = jacobian[a] * share - best[a];
    }

    void step_along_all() {
        for (std::int64_t a = 0; a < size; ++a) {
            for (std::int64_t b = 0; b < size; ++b) hessian[a * size + b] = a == b ? stiffness : 0;
            step[a] = -stiffness * best[a];
        }
        for (std::int64_t r = 0; r < rows; ++r) {
            const double *row = jacobian + r * size;
            for (std::int64_t a = 0; a < size; ++a) {
                step[a] -= row[a] * residual[r];
                for (std::int64_t b = 0; b < size; ++b) hessian[a * size + b] += row[a] * row[b];
            }
        }
        eliminate(hessian, step, size);
    }

    // The rows of a block that are below their aim, at most so many, the worst.
    void gather(std::int64_t block) {
        const std::int64_t K = f.instants, begin = f.block_first[block] * K, end = f.block_first[block + 1] * K;
        double *violation = present->violation, floor = 0;
        std::int64_t near = 0;
        for (std::int64_t e = begin; e < end; ++e) near += violation[e] > 0;
        if (near > f.law.most_rows) floor = at_rank(violation + begin, end - begin, near - f.law.most_rows);
        std::int64_t left = f.law.most_rows;
        for (bool as_floor : {false, true})  // of several that are equal, as of legs that move alike, the first
            for (std::int64_t e = begin; e < end && left; ++e) {
                if (as_floor ? floor == 0 || violation[e] != floor : !(violation[e] > floor)) continue;
                --left;
                double *row = jacobian + rows * size;
                rest.differentiate(*present, e / K, e % K, row);
                for (std::int64_t a = 0; a < size; ++a) row[a] /= f.softness[block];
                residual[rows++] = -violation[e];
            }
    }

    // The value that so many positive ones are not above.
    static double at_rank(const double *values, std::int64_t count, std::int64_t below) {
        double floor = 0;
        for (std::int64_t passed = 0; passed < below;) {
            double next = HUGE_VAL;
            for (std::int64_t e = 0; e < count; ++e)
                if (values[e] > floor && values[e] < next) next = values[e];
            floor = next;
            for (std::int64_t e = 0; e < count; ++e) passed += values[e] == floor;
        }
        return floor;
    }
};
