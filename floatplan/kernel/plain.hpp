// What the plain motion tells of a search before it begins, which goes with the problem, wherever its starts are.

// The level of grids that watches its rows: no link may jump over an obstacle between two nodes of it.
template <typename Flight>
static inline Index watching_level(Program<Flight> &program, const Nodes *levels,
                                   const Settings &settings, const Exchange &exchange, const SearchProblem &problem) {
    if (!problem.rows) return 0;
    if (!(problem.thickness < HUGE_VAL)) return exchange.constrained_level;
    program.watches = true;
    program.watch(exchange.compiled_level, nullptr, 0);
    program.squares(program.two[0], HUGE_VAL);
    const double most = program.flight.longest_way(program.two[0].state, program.two[0].motion);
    const double needed = most / larger(problem.thickness, exchange.smallest_step);
    for (Index level = 0; level < settings.levels; ++level)
        if (levels[level].nodes >= needed) return std::max(level, exchange.constrained_level);
    return exchange.watched_at_most;
}

// That, and an objective that is 1 at the plain motion; (17) is scaled by its variables. Neither counts as work.
template <typename Flight>
static inline void learn_from_plain(Program<Flight> &program, const Nodes *levels,
                                    const Settings &settings, const Exchange &exchange, SearchProblem &problem) {
    const Index evaluations = program.evaluations;
    const double work = program.work;
    Evaluated<Flight> &at = program.two[0];
    copy(at.x, problem.plain, program.size);
    problem.level = watching_level(program, levels, settings, exchange, problem);
    problem.closer_level = std::min(problem.level + exchange.closer, exchange.watched_at_most);
    problem.objective_scale = 1;
    if (problem.objective_sums) {
        program.watches = false;
        program.watch(problem.level, nullptr, 0);
        program.evaluate(at);
        problem.objective_scale = larger(at.objective, exchange.least_scale);
        program.watches = true;
    }
    program.evaluations = evaluations;
    program.work = work;
}
