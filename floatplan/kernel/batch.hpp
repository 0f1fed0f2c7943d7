// A batch of problems: from starts to judged answers. Included after plan.hpp, once for each set of instructions.

struct Arena {
    char *memory = nullptr;
    std::size_t used = 0;
    template <typename T> void take(T *&array, std::int64_t count) {
        if (memory) array = reinterpret_cast<T *>(memory + used);
        used += (count * sizeof(T) + 63) / 64 * 64;
    }
};

static inline void lay_out(Arena &arena, Memory &m, const Robot &robot, std::int64_t nodes, std::int64_t size) {
    std::int64_t n = robot.joints, bodies = robot.bodies, width = robot.width, columns = 6 + width;
    for (double **each : {&m.sine, &m.cosine, &m.rate, &m.fixed, &m.fixed_rate}) arena.take(*each, n * nodes);
    for (double **each : {&m.body_cosine, &m.body_sine, &m.turned, &m.inertia, &m.swing})
        arena.take(*each, bodies * nodes);
    for (double **each : {&m.base_rate, &m.inverse}) arena.take(*each, nodes);
    for (double **each : {&m.by_angle, &m.by_swing, &m.angle}) arena.take(*each, bodies * LANES);
    for (double **each : {&m.by_joint, &m.by_joint_rate, &m.joint_rate}) arena.take(*each, n * LANES);
    arena.take(m.by_z, n * width * LANES);
    for (double **each : {&m.z, &m.z_gradient}) arena.take(*each, n * width);
    arena.take(m.scaling, (width + 1) * width * width);
    arena.take(m.offset_map, (width + 1) * width * 6);
    for (double **each : {&m.offset, &m.x, &m.row, &m.previous_row, &m.trial, &m.direction, &m.lagrangian, &m.mapped,
                          &m.change, &m.product, &m.half})
        arena.take(*each, size);
    for (double **each : {&m.h, &m.h_initial}) arena.take(*each, size * size);
    arena.take(m.boundary, 6 * n);
    arena.take(m.b, n * columns);
    arena.take(m.matrix, columns * (columns + 6));
    arena.take(m.branch, n);
}

// The boundary of a motion that lands on other branches of the arcsine: odd ones mirror p about pi/2.
static inline void branched(const double *boundary, const std::int64_t *branch, std::int64_t n, double *result) {
    std::memcpy(result, boundary, 6 * n * sizeof(double));
    for (std::int64_t i = 0; i < n; ++i) {
        double *end = result + 6 * i + 3;
        if (branch[i] % 2)
            for (int c = 0; c < 3; ++c) end[c] = -end[c];
        end[0] += branch[i] * 3.141592653589793;
    }
}

// A start: the plain motion or the given one, then motions between two drawn at random of which one turns too much and
// one too little, so that (14) about holds; every second start lands on branches of its own. Where all turn too much, or
// all too little, the nearest is the start.
static inline void draw(Planner &planner, const Robot &robot, const Settings &settings, Memory &m,
                        const double *boundary, const double *given, std::int64_t number) {
    std::int64_t n = robot.joints, values = n * robot.width, size = planner.size;
    for (std::int64_t i = 0; i < n; ++i) m.branch[i] = 0;
    Random random{settings.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(number)};
    if (number && number % 2 == 0)
        for (std::int64_t i = 0; i < n; ++i) {
            std::uint64_t way = random.next() >> 62;  // straight on half of the time, else one branch up or down
            m.branch[i] = way == 0 ? 1 : way == 1 ? -1 : 0;
        }
    branched(boundary, m.branch, n, m.boundary);
    planner.set_boundary(m.boundary);
    for (std::int64_t e = 0; e < values; ++e) m.z[e] = number == 0 && given ? given[e] : 0;
    planner.variables(m.z, m.x);
    if (number == 0 || size == 0) return;
    planner.at_level(settings.level_of_starts);
    double *over = m.direction, *under = m.lagrangian, too_much = HUGE_VAL, too_little = -HUGE_VAL, nearest = HUGE_VAL;
    for (std::int64_t motion = 0; motion < settings.motions; ++motion) {
        double spread = settings.spreads[motion % 6];
        if (motion % 2) {  // cheap for the objective
            for (std::int64_t k = 0; k < size; ++k) m.trial[k] = spread * random.normal();
        } else {
            for (std::int64_t e = 0; e < values; ++e) m.z[e] = spread * random.normal();
            planner.variables(m.z, m.trial);
        }
        double missed = planner.evaluate(m.trial).equality;
        if (planner.unresolved() > settings.too_wild) continue;
        if (std::fabs(missed) < nearest) {
            nearest = std::fabs(missed);
            std::memcpy(m.x, m.trial, size * sizeof(double));
        }
        if (missed > 0 && too_much == HUGE_VAL) {
            too_much = missed;
            std::memcpy(over, m.trial, size * sizeof(double));
        } else if (missed < 0 && too_little == -HUGE_VAL) {
            too_little = missed;
            std::memcpy(under, m.trial, size * sizeof(double));
        }
        if (too_much != HUGE_VAL && too_little != -HUGE_VAL) break;
    }
    if (too_much == HUGE_VAL || too_little == -HUGE_VAL) return;
    for (std::int64_t step = 0; step < settings.secant_steps; ++step) {
        double part = too_much / (too_much - too_little);
        part = smaller(larger(part, 0.05), 0.95);
        for (std::int64_t k = 0; k < size; ++k) m.x[k] = over[k] + part * (under[k] - over[k]);
        double missed = planner.evaluate(m.x).equality;
        (missed > 0 ? too_much : too_little) = missed;
        std::memcpy(missed > 0 ? over : under, m.x, size * sizeof(double));
    }
}

static inline std::int64_t plan_batch(const Robot &robot, const Grid *grids, const std::int64_t *nodes,
                                      const Powers &powers, const Settings &settings, Batch &batch) {
    const std::int64_t n = robot.joints, width = robot.width, columns = 6 + width;
    std::int64_t size = 0, most_nodes = nodes[settings.levels + settings.finer - 1];
    for (std::int64_t i = 0; i < n; ++i) size += robot.free[i];
    Memory m;
    Arena measure;
    lay_out(measure, m, robot, most_nodes, size);
    void *memory = nullptr;
    if (posix_memalign(&memory, 64, measure.used) != 0) return 1;
    Arena arena{static_cast<char *>(memory)};
    lay_out(arena, m, robot, most_nodes, size);

    Planner planner(robot, grids, settings, m);
    planner.settings_nodes = nodes;
    Double2 time[MOST_COLUMNS];
    double duration = 0;
    for (std::int64_t row = 0; row < batch.count; ++row) {
        if (batch.duration[row] != duration) {
            duration = batch.duration[row];
            planner.whiten(duration, powers);
            time[0] = {1, 0};
            for (std::int64_t k = 1; k < columns; ++k) time[k] = time[k - 1] * Double2{duration, 0};
        }
        planner.h0 = batch.momentum[row];
        planner.change = batch.change[row];
        planner.evaluations = planner.instants = 0;
        const double *boundary = batch.boundary + row * 6 * n;
        bool quick = false;
        batch.status[row] = infeasible;
        batch.residual[row] = batch.objective[row] = HUGE_VAL;
        batch.iterations[row] = batch.starts[row] = batch.solved[row] = 0;
        for (std::int64_t number = 0; number < settings.most_starts; ++number) {
            const double *given = batch.start ? batch.start + row * n * width : nullptr;
            draw(planner, robot, settings, m, boundary, given, number);
            Solution solution = planner.solve(m.x);
            if (solution.status == needs_grid) {
                batch.status[row] = needs_grid;
                break;
            }
            batch.iterations[row] += solution.iterations;
            batch.starts[row] += 1;
            // Judged with twice the nodes.
            std::int64_t reached = planner.current_level();
            std::int64_t needed = planner.level_needed(settings.stages[2].quadrature_error);
            if (!planner.at_level((needed > reached ? needed : reached) + settings.finer)) {
                batch.status[row] = needs_grid;
                break;
            }
            double residual = std::fabs(planner.evaluate(m.x).equality), unresolved = planner.unresolved();
            bool resolved = unresolved <= settings.unresolved;
            bool holds = residual <= settings.tolerance && resolved;
            if (!resolved || std::isnan(residual)) residual = HUGE_VAL;
            if (!holds) solution.status = infeasible;
            else if (solution.status == infeasible) solution.status = feasible;
            quick = quick || (number == 0 && holds && solution.status == optimal &&
                              solution.iterations <= settings.easy_iterations);
            batch.solved[row] += holds;
            bool first = batch.status[row] == infeasible;
            if (holds || (first && (number == 0 || residual < batch.residual[row]))) {
                double square = 0;
                for (std::int64_t i = 0; i < n; ++i) {
                    double combination[MOST_COLUMNS];
                    std::memcpy(combination, m.boundary + 6 * i, 6 * sizeof(double));
                    std::memcpy(combination + 6, m.z + i * width, width * sizeof(double));
                    write_coefficients(combination, time, powers, columns, m.b + i * columns);
                }
                for (std::int64_t e = 0; e < n * columns; ++e) square += m.b[e] * m.b[e];
                double objective = std::sqrt(square);
                if (first || objective < batch.objective[row]) {
                    batch.status[row] = solution.status;
                    batch.residual[row] = residual;
                    batch.objective[row] = objective;
                    std::memcpy(batch.coefficients + row * n * columns, m.b, n * columns * sizeof(double));
                    std::memcpy(batch.z + row * n * width, m.z, n * width * sizeof(double));
                    std::memcpy(batch.branch + row * n, m.branch, n * sizeof(std::int64_t));
                }
            }
            if (size == 0) break;  // degree 5: there is but one motion
            if (batch.solved[row] >= settings.starts &&
                (quick || batch.solved[row] >= settings.wanted_after_failure))
                break;
        }
        batch.evaluations[row] = planner.evaluations;
        batch.instants[row] = planner.instants;
    }
    std::free(memory);
    return 0;
}
