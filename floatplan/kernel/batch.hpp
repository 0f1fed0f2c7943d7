// A batch of problems: where the search of each begins, and its judged answers. First the plain motion; then, of many
// motions, those that promise the least objective.

// The boundary of a motion that lands on other branches of the arcsine: odd ones mirror p about pi/2.
static inline void branched(const double *boundary, const Index *branch, Index n, double *result) {
    copy(result, boundary, 6 * n);
    for (Index i = 0; i < n; ++i) {
        double *end = result + 6 * i + 3;
        if (branch[i] % 2)
            for (int c = 0; c < 3; ++c) end[c] = -end[c];
        end[0] += branch[i] * 3.141592653589793;
    }
}

// Starts of one problem, in the order in which they are followed.
class Starts {
  public:
    Starts(Planner &planner, const Robot &robot, const Settings &settings, Memory &memory)
        : planner(planner), robot(robot), settings(settings), m(memory) {
        all_branches = 1;
        for (Index i = 0; i < robot.joints && all_branches <= settings.candidates; ++i) all_branches *= 3;
    }

    // Takes a problem, and the z that its start number 0 begins with; null: the plain motion's.
    void begin(const double *boundary, const double *given) {
        this->boundary = boundary;
        this->given = given;
        ranked = -1;
    }

    // Puts start number 0, 1, 2, ... into m.x. Of the first rounds of candidates those are followed that miss (14)
    // least; where these fail, all are.
    void follow(Index number) {
        if (number == 0) return first();
        Index round = (number - 1) / settings.followed;
        if (round >= settings.ranked_rounds)
            return draw(number + settings.ranked_rounds * (settings.candidates - settings.followed));
        if (round != ranked) rank(round);
        ranked = round;
        draw(m.candidate[(number - 1) % settings.followed]);
    }

  private:
    Planner &planner;
    const Robot &robot;
    const Settings &settings;
    Memory &m;
    const double *boundary = nullptr, *given = nullptr;
    Index ranked = -1;   // round of candidates that are in order
    Index all_branches;  // 3^n, or more than there are candidates

    void first() {
        Index n = robot.joints;
        for (Index i = 0; i < n; ++i) m.branch[i] = 0;
        planner.set_boundary(boundary);
        for (Index e = 0; e < n * robot.width; ++e) m.z[e] = given ? given[e] : 0;
        planner.variables(m.z, m.x);
    }

    void draw(Index candidate) {
        Index n = robot.joints;
        Random random{settings.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(candidate)};
        Index digits = candidate % all_branches;
        for (Index i = 0; i < n; ++i, digits /= 3) {
            Index way = digits % 3;
            if (all_branches > settings.candidates) {
                double drawn = random.uniform() / settings.changed_branches;
                way = drawn < 0.5 ? 1 : drawn < 1 ? 2 : 0;
            }
            m.branch[i] = way == 2 ? -1 : way;
        }
        branched(boundary, m.branch, n, m.boundary);
        planner.set_boundary(m.boundary);
        double spread = candidate <= settings.candidates ? 0 : settings.spreads_of_starts[candidate % 6];
        for (Index e = 0; e < n * robot.width; ++e) m.z[e] = spread * random.normal();
        planner.variables(m.z, m.x);
    }

    void rank(Index round) {
        for (Index place = 0; place < settings.candidates; ++place) {
            Index candidate = 1 + round * settings.candidates + place;
            draw(candidate);
            double merit = missed();
            Index at = place;
            for (; at > 0 && m.merit[at - 1] > merit; --at) {
                m.merit[at] = m.merit[at - 1];
                m.candidate[at] = m.candidate[at - 1];
            }
            m.merit[at] = merit;
            m.candidate[at] = candidate;
        }
    }

    // By how much (14) is missed after one step towards where it would hold, were it linear.
    double missed() {
        planner.at_level(settings.level_of_starts);
        for (Index step = 0; step < settings.steps_to_rank; ++step) {
            Point point = planner.evaluate(m.x);
            planner.differentiate(point, m.row);
            double square = dot(m.row, m.row, planner.size);
            if (!(square > 0)) return HUGE_VAL;
            double part = (dot(m.row, m.x, planner.size) - point.equality) / square;
            for (Index k = 0; k < planner.size; ++k) m.direction[k] = part * m.row[k] - m.x[k];
            double way = larger(planner.metric(m.direction), 1e-300);
            add(smaller(1.0, settings.step_to_rank / way), m.direction, planner.size, m.x);
        }
        double missed = std::fabs(planner.evaluate(m.x).equality);
        return planner.unresolved() > settings.too_wild ? HUGE_VAL : missed;
    }
};

static inline void lay_out(Arena &arena, Memory &m, const Robot &robot, const Settings &settings, Index nodes,
                           Index size) {
    Index n = robot.joints, width = robot.width, columns = 6 + width;
    lay_out_turn(arena, m.motion, robot, nodes);
    for (double **each : {&m.fixed, &m.fixed_rate}) arena.take(*each, n * nodes);
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
    arena.take(m.merit, settings.candidates);
    arena.take(m.candidate, settings.candidates);
}

Index plan_batch(const Robot &robot, const Grid *grids, const Index *nodes,
                 const Powers &powers, const Settings &settings, Batch &batch) {
    const Index n = robot.joints, width = robot.width, columns = 6 + width;
    Index size = 0, most_nodes = nodes[settings.levels - 1];
    for (Index i = 0; i < n; ++i) size += robot.free[i];
    Memory m;
    Room room;
    if (!room.make([&](Arena &arena) { lay_out(arena, m, robot, settings, most_nodes, size); })) return 1;
    Planner planner(robot, grids, settings, m);
    planner.node_counts = nodes;
    Starts starts(planner, robot, settings, m);
    Double2 time[MOST_COLUMNS];
    double duration = 0;
    for (Index row = 0; row < batch.count; ++row) {
        if (batch.duration[row] != duration) {
            duration = batch.duration[row];
            planner.whiten(duration, powers);
            time[0] = {1, 0};
            for (Index k = 1; k < columns; ++k) time[k] = time[k - 1] * duration;
        }
        planner.h0 = batch.momentum[row];
        planner.change = batch.change[row];
        planner.evaluations = planner.instants = 0;
        const double *boundary = batch.boundary + row * 6 * n;
        bool quick = false;
        double nearest = HUGE_VAL;
        Index as_near = 0;  // starts that ended as near to (14) as any
        batch.status[row] = infeasible;
        batch.residual[row] = batch.objective[row] = HUGE_VAL;
        batch.iterations[row] = batch.starts[row] = batch.solved[row] = 0;
        starts.begin(boundary, batch.start ? batch.start + row * n * width : nullptr);
        for (Index number = settings.first_start; number < settings.most_starts; ++number) {
            starts.follow(number);
            Solution solution = planner.solve(m.x, number ? settings.hopeless_way : HUGE_VAL);
            if (solution.status == needs_grid) {
                batch.status[row] = needs_grid;
                break;
            }
            batch.iterations[row] += solution.iterations;
            batch.starts[row] += 1;
            // Judged with twice the nodes, or as many as there are.
            Index reached = planner.current_level();
            Index needed = planner.level_needed(settings.stages[2].quadrature_error);
            Index judging = (needed > reached ? needed : reached) + settings.finer;
            if (!planner.at_level(judging < settings.levels ? judging : settings.levels - 1)) {
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
            if (holds || (first && (number == settings.first_start || residual < batch.residual[row]))) {
                for (Index i = 0; i < n; ++i) {
                    double combination[MOST_COLUMNS];
                    copy(combination, m.boundary + 6 * i, 6);
                    copy(combination + 6, m.z + i * width, width);
                    write_coefficients(combination, time, powers, columns, m.b + i * columns);
                }
                double objective = std::sqrt(dot(m.b, m.b, n * columns));
                if (first || objective < batch.objective[row]) {
                    batch.status[row] = solution.status;
                    batch.residual[row] = residual;
                    batch.objective[row] = objective;
                    copy(batch.coefficients + row * n * columns, m.b, n * columns);
                    copy(batch.z + row * n * width, m.z, n * width);
                    for (Index i = 0; i < n; ++i) batch.branch[row * n + i] = m.branch[i];
                }
            }
            if (size == 0) break;  // degree 5: there is but one motion
            if (residual < nearest * (1 - settings.agreement)) as_near = 0;
            if (residual < nearest * (1 + settings.agreement)) ++as_near;
            nearest = smaller(nearest, residual);
            if (!batch.solved[row] && number >= settings.starts_to_agree && as_near >= settings.agreeing) break;
            if (batch.solved[row] >= settings.starts && (quick || batch.solved[row] >= settings.wanted_after_failure))
                break;
        }
        batch.evaluations[row] = planner.evaluations;
        batch.instants[row] = planner.instants;
    }
    return 0;
}
