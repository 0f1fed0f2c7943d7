// A program at one x as the search sees it, with the derivatives of all of its rows: what tests hold to differences and to
// Pinocchio, and what other solvers are given.

template <typename Flight>
static inline Index evaluate(const typename Flight::Body &body, const Constraints &constraints, const Motions &motions,
                             const Nodes *levels, const Settings &settings, const Exchange &exchange, SearchProblem &problem,
                             Evaluation &at) {
    Program<Flight> program(body, constraints, motions, levels, settings, exchange, problem);
    Sqp<Flight> search(program, settings, exchange, problem);
    const Index nodes = levels[settings.levels - 1].nodes, size = program.size;
    Workspace room;
    if (!room.make([&](Arena &arena) {
            program.lay_out(arena, nodes);
            search.lay_out(arena, problem.rows * ((nodes + exchange.most_instants + 7) / 8 * 8));
        }))
        return 1;
    learn_from_plain(program, levels, settings, exchange, problem);
    program.back_off = at.back_off;
    program.watch(at.level, at.others, at.extra);
    Evaluated<Flight> &now = *search.now;
    copy(now.x, at.x, size);
    program.evaluate(now);
    program.differentiate(now);
    const Index entries = problem.rows * program.stride;
    for (Index entry = 0; entry < entries; ++entry) {
        const double *slopes = program.pack_of(now, entry) + entry % 8;
        for (Index c = 0; c < size; ++c) at.slopes[entry * size + c] = slopes[8 * c];
    }
    at.objective = now.objective;
    copy(at.equality, now.equality, program.equalities);
    copy(at.values, now.values, entries);
    copy(at.gradient, now.gradient, size);
    copy(at.row, now.row, program.equalities * size);
    program.guess_hessian(now, search.hessian);
    copy(at.hessian, search.hessian, size * size);
    if (at.penalty > 0) copy(at.step, search.elastic_step(at.penalty), size);
    return 0;
}

Index evaluate_program(const Robot &robot, const Constraints &constraints, const Motions &motions, const Nodes *levels,
                       const Settings &settings, const Exchange &exchange, SearchProblem &problem, Evaluation &at) {
    return evaluate<PlanarFlightEvaluator>(robot, constraints, motions, levels, settings, exchange, problem, at);
}

Index evaluate_in_space(const SpatialBody &body, const Cells *cells, const Constraints &constraints, const Motions &motions,
                        const Nodes *levels, const Settings &settings, const Exchange &exchange, SearchProblem &problem,
                        Evaluation &at) {
    return evaluate<SpatialFlightEvaluator>({body, cells, body.joints}, constraints, motions, levels, settings, exchange, problem, at);
}
