// The rest of a flight: from where the joints are to the landing, changed as little as the miss of (14) is worth.

// Gauss-Newton steps on miss^2 / sigma^2 + stiffness |y|^2, z moved by the whitening's y: the law of
// floatplan/inflight/law.py where no limit is near.
static inline std::int64_t correct_rest(const Robot &robot, const Grid &grid, const Settings &settings, Rest &rest) {
    const std::int64_t n = robot.joints, width = robot.width, size = n * width;
    Memory m;
    Room room;
    if (!room.make([&](Arena &arena) { lay_out(arena, m, robot, settings, grid.nodes, size); })) return 1;
    Planner planner(robot, &grid, settings, m);
    planner.h0 = rest.momentum;
    planner.change = rest.change;
    planner.begin(rest.duration, rest.boundary, 0);

    double *best = m.x, *y = m.trial, *row = m.row, *step = m.direction, *by_z = m.lagrangian;
    double miss = 0, least = HUGE_VAL, expected = 0;
    auto missed = [&](const double *y) {
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t r = 0; r < width; ++r) {
                double part = 0;
                for (std::int64_t c = 0; c < width; ++c) part += rest.whitening[r * width + c] * y[i * width + c];
                m.z[i * width + r] = rest.z[i * width + r] + part / rest.amplitude[i];
            }
        return planner.evaluate_z().equality;
    };
    auto next_step = [&] {  // of the motion evaluated last
        planner.differentiate_z(by_z);
        double square = 0, along = 0, moved = 0;
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int64_t c = 0; c < width; ++c) {
                double part = 0;
                for (std::int64_t r = 0; r < width; ++r) part += by_z[i * width + r] * rest.whitening[r * width + c];
                row[i * width + c] = part / rest.amplitude[i];
            }
        for (std::int64_t k = 0; k < size; ++k) {
            square += row[k] * row[k];
            along += row[k] * best[k];
        }
        double scale = rest.sigma * rest.sigma * rest.stiffness, part = (along - miss) / (square + scale);
        for (std::int64_t k = 0; k < size; ++k) {
            step[k] = part * row[k] - best[k];
            moved += part * row[k] * part * row[k];
        }
        double left = (miss - along + part * square) / rest.sigma;
        expected = left * left + rest.stiffness * moved;
    };

    for (std::int64_t k = 0; k < size; ++k) best[k] = 0;
    miss = missed(best);
    least = miss * miss / (rest.sigma * rest.sigma);
    next_step();
    for (std::int64_t tried = 0; tried < rest.evaluations; ++tried) {
        if (least - expected < rest.settled * rest.settled) break;
        double length = 0, moved = 0;
        for (std::int64_t k = 0; k < size; ++k) {
            y[k] = best[k] + step[k];
            length += y[k] * y[k];
            moved += step[k] * step[k];
        }
        double now = missed(y), cost = now * now / (rest.sigma * rest.sigma) + rest.stiffness * length;
        if (!(cost < least)) {
            for (std::int64_t k = 0; k < size; ++k) step[k] *= rest.shorter;
            moved *= rest.shorter * rest.shorter;
            if (!std::isfinite(cost) || rest.stiffness * moved < rest.settled * rest.settled) break;
            continue;
        }
        bool settled = cost - expected <= rest.settled * cost + rest.settled * rest.settled;
        std::memcpy(best, y, size * sizeof(double));
        miss = now;
        least = cost;
        if (settled) break;
        next_step();
    }
    std::memcpy(rest.y, best, size * sizeof(double));
    rest.miss = miss;
    rest.evaluated = planner.evaluations;
    return 0;
}
