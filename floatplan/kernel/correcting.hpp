// The correction with the least sum of miss at the landing, change of the accelerations, and breach of limits, softly.
// With the miss c, the change y from the plan's motion and the rows g of the limits that are near, each of one instant,
// a few Gauss-Newton steps on
//
//     |c|^2 / sigma^2 + |y|^2 / (a^2 tau^4) + sum_j min(g_j - aim_j, 0)^2 / softness_j^2,
//
// tau the time that remains. The second term makes the last corrections fade: what is left to correct and the time for
// it both go to zero, and the minimal-norm correction's torque would grow like 1 / tau^2. It is of the change from the
// plan, not from the motion at hand: what many corrections did for estimates that have changed since is taken back.

template <typename Remaining> class Correcting {
  public:
    using At = Predicted<Remaining>;
    static constexpr Index e = Remaining::equalities;

    Correcting(const CorrectedFlight &flight, RestOfFlight<Remaining> &rest, Index joints)
        : f(flight), rest(rest), n(joints), width(f.width), size(n * width) {}

    void lay_out(Arena &arena) {
        const Index most = e + f.options.most_rows * f.blocks;
        for (double **each : {&best, &y, &step, &begun}) arena.take(*each, size);
        arena.take(of_miss, e * size);
        arena.take(system, size * size);
        arena.take(shares, size);
        arena.take(jacobian, most * size);
        arena.take(residual, most);
        arena.take(first, (6 + width) * n);
        arena.take(worst, f.blocks);
        arena.take(near, f.block_first[f.blocks] * f.instants + 1);
        for (At *each : {present, tried}) rest.lay_out(arena, *each);
    }

    // What comes of a motion as it is.
    void predict(const double *coefficients, Corrected &found) {
        copy(present->coefficients, coefficients, (6 + width) * n);
        rest.evaluate(*present);
        found.fraction = found.evaluated = 1;
        copy(f.row_values, present->value, f.block_first[f.blocks] * f.instants);
        report(found);
    }

    // Corrects the motion whose coefficients are given; leaves the new ones, and what comes of them, in `f`.
    void correct(const double *coefficients, Index evaluations, Corrected &found) {
        copy(present->coefficients, coefficients, (6 + width) * n);
        rest.evaluate(*present);
        begin_at_present();
        found.evaluated = 1;
        const bool warm = f.is_warm && warm_start(found);
        const double missed = present->missed();
        const bool far = f.blocks && missed > f.options.far;
        if (far) evaluations = evaluations > f.options.evaluations_far ? evaluations : f.options.evaluations_far;
        const bool landed = far && rest.has_distances && solve_as_landed(evaluations, missed, found);
        if (far && rest.has_distances) evaluations = f.options.evaluations_near;
        if (!landed) solve(evaluations, found);
        found.fraction = 1;
        if (!landed && !keeps(*present)) {
            copy(y, best, size);
            found.fraction = 0;
            for (double scale : {f.options.scales[0], f.options.scales[1]}) {
                for (Index k = 0; k < size; ++k) step[k] = begun[k] + scale * (y[k] - begun[k]);
                change(*tried, step, found);
                if (!keeps(*tried) || !(tried->missed() < missed)) continue;
                found.fraction = scale;
                copy(best, step, size);
                std::swap(present, tried);
                break;
            }
            if (found.fraction == 0) {
                copy(best, begun, size);
                change(*present, best, found);
                found.fraction = warm;
            }
        }
        copy(f.coefficients, present->coefficients, (6 + width) * n);
        report(found);
    }

  private:
    const CorrectedFlight &f;
    RestOfFlight<Remaining> &rest;
    At two[2] = {}, *present = two, *tried = two + 1;
    Index n, width, size, rows = 0;
    double stiffness = 0, expected = 0;
    double *best, *y, *step, *begun, *system, *shares, *jacobian, *residual, *first, *worst;
    double *of_miss;  // (e, size): of the present motion
    Index *near;      // of a block, the numbers row * K + instant of what is below its aim

    // What is kept, and what changes are of: the present motion.
    void begin_at_present() {
        copy(first, present->coefficients, (6 + width) * n);
        copy(worst, present->worst, f.blocks);
    }

    static constexpr double alike = 1e-12;  // [-] of squares: what is left of a row that is rounding alone

    // By how much that differs from the plan's, but for what turns the base: what the miss needs is not taken back.
    void compare_with_plan() {
        for (Index i = 0; i < n; ++i)
            for (Index k = 0; k < width; ++k) {
                double change = 0;
                for (Index c = 0; c < 6 + width; ++c)
                    change += f.unwhitening[k * (6 + width) + c] * (first[c * n + i] - f.planned[c * n + i]);
                begun[i * width + k] = f.amplitude[i] * change;
            }
        rest.differentiate_miss(*present, of_miss);
        copy(jacobian, of_miss, e * size);
        for (Index a = 0; a < e; ++a) {  // each row less what those before it do
            double *row = jacobian + a * size;
            const double whole = dot(row, row, size);
            for (Index b = 0; b < a; ++b) take_off(jacobian + b * size, row);
            if (dot(row, row, size) > alike * whole) take_off(row, begun);
            else zero(row, size);
        }
        for (Index k = 0; k < size; ++k) begun[k] *= f.options.taken_back;
    }

    // The component along a row, taken off.
    void take_off(const double *row, double *from) const {
        const double square = dot(row, row, size);
        if (square > 0) add(-dot(row, from, size) / square, row, size, from);
    }

    void report(Corrected &found) {
        copy(found.miss, present->miss, e);
        copy(f.worst, present->worst, f.blocks);
        rest.find_torque_peaks(*present);
    }

    // Begins at the motion that is prepared, where that lands nearer; what is left is corrected from there.
    bool warm_start(Corrected &found) {
        copy(tried->coefficients, first, (6 + width) * n);
        add(1, f.warm_start, size, tried->coefficients + 6 * n);
        rest.evaluate(*tried);
        ++found.evaluated;
        if (!(tried->missed() < smaller(present->missed(), f.options.far) && keeps(*tried))) return false;
        std::swap(present, tried);
        begin_at_present();
        return true;
    }

    // With distances as if the base were to reach the goal, so that feet in the ground do not keep it from turning
    // there; false, and back at the first motion, where it is no nearer then or something is broken.
    bool solve_as_landed(Index evaluations, double missed, Corrected &found) {
        rest.land(true);
        rest.evaluate(*present);
        solve(evaluations, found);
        rest.land(false);
        rest.evaluate(*present);
        found.evaluated += 2;
        if (present->missed() < missed && keeps(*present)) return true;
        copy(present->coefficients, first, (6 + width) * n);
        rest.evaluate(*present);
        return false;
    }

    bool keeps(const At &a) const {
        for (Index b = 0; b < f.blocks; ++b)
            if (!(a.worst[b] >= -f.options.kept || worst[b] < -f.options.kept)) return false;
        return true;
    }

    void change(At &a, const double *to, Corrected &found) const {
        for (Index c = 0; c < 6 + width; ++c)
            for (Index i = 0; i < n; ++i) {
                double part = 0;
                for (Index k = 0; c >= 6 && k < width; ++k)
                    part += f.whitening[(c - 6) * width + k] * (to[i * width + k] - begun[i * width + k]);
                a.coefficients[c * n + i] = first[c * n + i] + part / f.amplitude[i];
            }
        rest.evaluate(a);
        ++found.evaluated;
    }

    double tolerance(double missed) const {
        return f.blocks ? larger(f.sigma, missed / f.options.weighed) : f.sigma;
    }

    double cost(const At &a, const double *of, double sigma) const {
        double squares = 0;
        for (double miss : a.miss) squares += (miss / sigma) * (miss / sigma);
        return squares + stiffness * dot(of, of, size) + a.square;
    }

    // Gauss-Newton steps from the present motion, which is left the best one, by `best` from the plan's.
    void solve(Index evaluations, Corrected &found) {
        const double enough = f.options.settled * f.options.settled, square = f.acceleration * rest.T * rest.T;
        stiffness = 1 / (square * square);
        compare_with_plan();
        copy(best, begun, size);
        double sigma = tolerance(present->missed()), lowest_cost = cost(*present, best, sigma);
        next_step(sigma);
        for (Index number = 0; number < evaluations; ++number) {
            if (lowest_cost - expected < enough) break;
            for (Index k = 0; k < size; ++k) y[k] = best[k] + step[k];
            change(*tried, y, found);
            double now = cost(*tried, y, sigma);
            if (!(now < lowest_cost)) {
                for (Index k = 0; k < size; ++k) step[k] *= f.options.shorter;
                if (!std::isfinite(now) || stiffness * dot(step, step, size) < enough) break;
                continue;
            }
            bool settled = now - expected <= f.options.settled * now + enough;
            copy(best, y, size);
            std::swap(present, tried);
            double nearer = tolerance(present->missed());
            if (settled && nearer > sigma / 2) break;
            sigma = nearer;
            lowest_cost = cost(*present, best, sigma);
            if (number + 1 == evaluations) continue;
            rest.differentiate_miss(*present, of_miss);
            next_step(sigma);
        }
    }

    // The step, and the cost that it would have if everything were linear.
    void next_step(double sigma) {
        for (Index k = 0; k < e * size; ++k) jacobian[k] = of_miss[k] / sigma;
        for (Index a = 0; a < e; ++a) residual[a] = present->miss[a] / sigma;
        rows = e;
        for (Index block = 0; block < f.blocks; ++block) gather(block);
        if (rows < size) step_by_rows();
        else step_by_changes();
        expected = 0;
        for (Index r = 0; r < rows; ++r) {
            const double left = dot(jacobian + r * size, step, size, residual[r]);
            expected += left * left;
        }
        for (Index a = 0; a < size; ++a) expected += stiffness * (best[a] + step[a]) * (best[a] + step[a]);
    }

    // With the matrix J of the rows and their residuals r: the least sum is at y = J^T (J J^T + stiffness)^-1 (J best - r),
    // as many equations as there are rows, most often one for each number of the miss.
    void step_by_rows() {
        for (Index a = 0; a < rows; ++a) {
            multiply_vector(jacobian, rows, size, size, jacobian + a * size, system + a * rows);
            system[a * rows + a] += stiffness;
        }
        multiply_vector(jacobian, rows, size, size, best, shares);
        for (Index a = 0; a < rows; ++a) shares[a] -= residual[a];
        eliminate(system, shares, rows);
        for (Index k = 0; k < size; ++k) step[k] = -best[k];
        for (Index a = 0; a < rows; ++a) add(shares[a], jacobian + a * size, size, step);
    }

    // The same by (J^T J + stiffness) step = -J^T r - stiffness best, as many equations as there are changes.
    void step_by_changes() {
        zero(system, size * size);
        for (Index a = 0; a < size; ++a) {
            system[a * size + a] = stiffness;
            step[a] = -stiffness * best[a];
        }
        for (Index r = 0; r < rows; ++r) {
            const double *row = jacobian + r * size;
            add(-residual[r], row, size, step);
            for (Index a = 0; a < size; ++a) add(row[a], row, size, system + a * size);
        }
        eliminate(system, step, size);
    }

    // The rows of a block that are below their aim, at most so many, the worst.
    void gather(Index block) {
        const double *violation = present->violation;
        if (present->worst[block] >= f.aim[block]) return;
        Index *end = near;
        const Index last = f.block_first[block + 1] * f.instants;
        for (Index entry = f.block_first[block] * f.instants; entry < last; ++entry) {
            *end = entry;  // kept where the next one is not written over it
            end += violation[entry] > 0;
        }
        if (end - near > f.options.most_rows) {
            const auto is_worse = [violation](Index a, Index b) {  // of legs that move alike, the first
                return violation[a] != violation[b] ? violation[a] > violation[b] : a < b;
            };
            std::nth_element(near, near + f.options.most_rows, end, is_worse);
            end = near + f.options.most_rows;
            std::sort(near, end);
        }
        for (const Index *entry = near; entry < end; ++entry) {
            double *row = jacobian + rows * size;
            rest.differentiate(*present, *entry / f.instants, *entry % f.instants, row);
            for (Index a = 0; a < size; ++a) row[a] /= f.softness[block];
            residual[rows++] = -violation[*entry];
        }
    }
};
