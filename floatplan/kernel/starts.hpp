// Starts by their numbers: number 0 is the x given; where h is free, the same x at other h takes turns with the first of
// the others. Each of these is the one of some random motions that violates (14) and the rows least; without rows they are
// those of ranked.hpp.

template <typename Flight> class NumberedStarts {
  public:
    NumberedStarts(Program<Flight> &program, BranchedMotions &motions, const Settings &settings, const Exchange &exchange,
                   double bodies, SamplingOptions &sampling, Index joints)
        : program(program), motions(motions), ranked(program, motions, settings, sampling, joints), exchange(exchange),
          bodies(bodies), sampling(sampling), n(joints), free(motions.at.first[joints]), size(motions.at.size) {}

    void lay_out(Arena &arena) {
        for (double **each : {&spatial_body, &z}) arena.take(*each, size);
        for (double **each : {&inverse, &matrix}) arena.take(*each, free * free);
        ranked.lay_out(arena);
    }

    // The x of number 0, of the class that is plain.
    void begin(const double *x) {
        copy(spatial_body, x, size);
        has_inverse = false;
    }

    // Takes the class of a start and writes its x; whether it is one to follow straight to the objective.
    bool place(Index number, double *x) {
        const Index fractions = motions.at.axes ? sampling.fractions : 0, beyond = number - 2 * fractions;
        const bool is_drawn = beyond > 0 || (number > 0 && number % 2 == 0);
        for (Index i = 0; i < n; ++i) sampling.branch[i] = 0;
        if (is_drawn) {
            const Index drawn = beyond > 0 ? number - fractions - 1 : number / 2 - 1;
            program.uses_adjoint ? ranked.draw(drawn, x) : draw(drawn, x);
        } else {
            motions.land_on(sampling.branch);
            copy(x, spatial_body, size);
            if (number) x[free] = sampling.fraction[number / 2];
        }
        return !is_drawn;
    }

  private:
    Program<Flight> &program;
    BranchedMotions &motions;
    RankedStarts<Flight> ranked;
    const Exchange &exchange;
    const double bodies;
    SamplingOptions &sampling;
    Index n, free, size;
    bool has_inverse = false;
    double *spatial_body, *z, *inverse, *matrix;  // the last two of the scaling

    void find_inverse() {
        has_inverse = true;
        copy(matrix, motions.at.scaling, free * free);
        zero(inverse, free * free);
        for (Index k = 0; k < free; ++k) inverse[k * free + k] = 1;
        eliminate(matrix, inverse, free, free);
    }

    // Half of the motions are drawn in z, half are cheap for the objective, on the plain branches and on others in turns.
    void draw(Index number, double *x) {
        Random random{sampling.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(number + 1)};
        for (Index i = 0; number % 2 && i < n; ++i) {
            const double drawn = random.uniform();
            sampling.branch[i] = drawn < 0.25 ? -1 : drawn < 0.75 ? 0 : 1;
        }
        if (!has_inverse) find_inverse();
        motions.land_on(sampling.branch);
        program.back_off = 0;
        program.watches = true;
        program.watch(sampling.level, nullptr, 0);
        Evaluated<Flight> &at = program.two[0];
        double least = HUGE_VAL;
        for (Index k = 0; k < sampling.random; ++k) {
            const double spread = sampling.spreads[k / 2 % 6];
            for (Index i = 0; i < free; ++i) z[i] = spread * random.normal();
            if (k % 2) {
                copy(at.x, z, free);
            } else {
                for (Index i = 0; i < free; ++i) z[i] -= motions.at.offset[i];
                multiply(inverse, free, free, z, 1, at.x);
            }
            for (Index a = free; a < size; ++a) at.x[a] = 2 * random.uniform() - 1;
            const double violated = program.squares(at, least);
            if (k && !(violated < least)) continue;
            least = violated;
            copy(x, at.x, size);
        }
        const double instants = sampling.random * program.nodes();
        program.work += exchange.evaluation + instants * bodies;  // all of them together
    }
};

// Starts followed one after the other; none where it is asked first whether any motion may hold, and the answer is no.
//
// Where so many solutions are wanted, it goes on until there are, and until more of them promise little: the plain motion
// was solved quickly, or several were found. It gives up where starts end equally far from the goal, and none nearer.
// Else it ends with the first that holds, or when work has been done that the search is to know of. What the most work
// ends is left out where it is not the first: how far it came hangs on what was done before. Where the first one leads to an
// optimum, but has taken long, the optima without rows are compared with that.
template <typename Flight> class FollowedStarts {
  public:
    FollowedStarts(const typename Flight::Body &body, const Constraints &constraints, const Motions &plain,
                   const Nodes *levels, const Settings &settings, const Exchange &exchange, const Powers *powers,
                   SearchProblem &problem, SamplingOptions &sampling)
        : body(body), constraints(constraints), joints(body.joints), columns(plain.columns), size(plain.size),
          motions(plain, sampling.offset_map, body.joints),
          follower(body, constraints, motions.at, levels, settings, exchange, problem),
          starts(follower.program, motions, settings, exchange, problem.bodies, sampling, body.joints), levels(levels),
          settings(settings), exchange(exchange), powers(powers), problem(problem), sampling(sampling) {}

    void lay_out(Arena &arena) {
        motions.lay_out(arena);
        starts.lay_out(arena);
        follower.lay_out(arena);
        for (double **each : {&x, &best}) arena.take(*each, size);
        arena.take(b, joints * columns);
        arena.take(branch, joints);
        if (problem.compares) {
            Arena needed;
            without_rows().lay_out(needed);
            arena.take(room_without_rows, needed.numbers());
        }
    }

    void follow() {
        starts.begin(problem.x);
        problem.started = problem.solved = problem.ends_hold = problem.path_is_clear = 0;
        starts.place(0, x);
        learn_from_plain(follower.program, levels, settings, exchange, problem);
        const bool at_once = problem.at_once;
        if (problem.reach > 0 && problem.first == 0 && !follower.may_hold(x)) {
            follower.finish(x, problem.level, infeasible);
        } else if (!problem.count) {
            follower.judge_given(x);
        } else {
            follow_all(at_once);
            if (!is_best) take_best();
        }
        if (problem.coefficients && !problem.wanted) follower.write(motions.at, *powers, joints, problem.coefficients);
        if (problem.objective_sums) problem.objective = follower.finest_objective();
        problem.at_once = at_once;
    }

  private:
    const typename Flight::Body &body;
    const Constraints &constraints;
    const Index joints, columns, size;
    BranchedMotions motions;
    Follower<Flight> follower;
    NumberedStarts<Flight> starts;
    const Nodes *levels;
    const Settings &settings;
    const Exchange &exchange;
    const Powers *powers;
    SearchProblem &problem;
    SamplingOptions &sampling;
    double *x, *b;                                  // of the start that is followed
    double *room_without_rows;
    double *best;                                   // x of the best one, and what else is kept of that
    Index *branch, level = 0, status = infeasible;
    double least = HUGE_VAL, cost = HUGE_VAL;       // least: violation; cost: |b|
    double missed[3] = {};
    double nearest = HUGE_VAL;                      // least violation of all, and how many starts ended with that
    Index as_near = 0;
    bool is_best = false, is_easy = false;          // of the last one; whether the plain motion was solved quickly

    void follow_all(bool at_once) {
        for (Index number = problem.first; number < problem.first + problem.count; ++number) {
            const SearchProblem before = problem;
            problem.at_once = starts.place(number, x) && (number || at_once);
            if (problem.started) follower.worth = larger(least, exchange.near_miss);
            if (number) follower.leave_hopeless();
            follower.follow(x);
            if (problem.started && follower.program.work > problem.most_work) {
                problem = before;
                is_best = false;
                break;
            }
            const bool holds = problem.violation <= 0;
            problem.solved += holds;
            is_easy |= !number && holds && problem.status == optimal && problem.iterations <= settings.easy_iterations;
            is_best = compare(holds);
            ++problem.started;
            if (is_best) keep();
            const bool is_long = follower.program.work > exchange.long_work;
            if (problem.compares && !number && holds && problem.status == optimal && is_long) compare_with_unconstrained();
            if (problem.wanted ? are_enough(number) : least <= 0 || follower.program.work > exchange.enough_work) break;
        }
    }

    // Whether where a start ended is the best so far: it violates least, or of several that hold has the least |b|.
    bool compare(bool holds) {
        const bool is_nearer = !problem.started || problem.violation < least;
        if (!problem.wanted || !(is_nearer || holds)) return is_nearer;
        problem.objective = coefficients_of(follower);
        return is_nearer || problem.objective < cost;
    }

    // Takes the cheapest optimum without rows that keeps to all of them, where it costs less than where the first start ended.
    // As many are looked for as take a share of its work.
    void compare_with_unconstrained() {
        UnconstrainedOptima<Flight> optima = without_rows();
        Arena room = aligned(room_without_rows);
        optima.lay_out(room);
        const double most_work = exchange.share_unconstrained * follower.program.work;
        cost = coefficients_of(follower);
        follower.worth = exchange.near_miss;
        is_best = false;  // from now on what it has left is that of another motion
        for (Index number = 0; number < settings.followed * settings.ranked_rounds && optima.work() < most_work; ++number) {
            if (!optima.find(number, x) || !(coefficients_of(optima.last()) < cost)) continue;
            follower.judge_given(x);
            if (problem.violation > 0) continue;
            problem.status = optimal;
            problem.objective = coefficients_of(follower);
            keep();
        }
        problem.evaluations = follower.program.evaluations + optima.evaluations();
        problem.work = follower.program.work + optima.work();
    }

    UnconstrainedOptima<Flight> without_rows() {
        return {body, constraints, motions, levels, settings, exchange, problem, sampling, joints};
    }

    // |b| of where a start has ended last.
    double coefficients_of(const Follower<Flight> &ended) {
        ended.write(motions.at, *powers, joints, b);
        return std::sqrt(dot(b, b, joints * columns));
    }

    void keep() {
        least = problem.violation;
        copy(missed, problem.missed, 3);
        cost = problem.objective;
        level = problem.judged_level;
        status = problem.status;
        copy(best, problem.x, size);
        std::copy(sampling.branch, sampling.branch + joints, branch);
        if (problem.wanted) copy(problem.coefficients, b, joints * columns);
    }

    void take_best() {
        std::copy(branch, branch + joints, sampling.branch);
        motions.land_on(branch);
        if (!problem.wanted) return follower.finish(best, level, status);
        copy(problem.x, best, size);
        problem.violation = least;
        copy(problem.missed, missed, 3);
        problem.objective = cost;
        problem.judged_level = level;
        problem.status = status;
    }

    bool are_enough(Index number) {
        if (!size) return true;  // there is but one motion
        const double left = problem.violation;
        if (left < nearest * (1 - settings.agreement)) as_near = 0;
        if (left < nearest * (1 + settings.agreement)) ++as_near;
        nearest = smaller(nearest, left);
        if (!problem.solved) return number >= settings.starts_to_agree && as_near >= settings.agreeing;
        return problem.solved >= problem.wanted && (is_easy || problem.solved >= settings.wanted_after_failure);
    }
};

// So many problems of one robot, degrees and kinds of rows, each with starts of its own; what flies is told by row.
template <typename Flight, typename BodyOf>
static inline Index follow_each(BodyOf body_of, const Constraints *constraints, const Motions *motions,
                                const Nodes *levels, const Settings &settings, const Exchange &exchange,
                                const Powers *powers, SearchProblem *problems, SamplingOptions *sampling, Index count) {
    for (Index row = 0; row < count; ++row) {
        const typename Flight::Body body = body_of(row);
        FollowedStarts<Flight> starts(body, constraints[row], motions[row], levels, settings, exchange, powers,
                                      problems[row], sampling[row]);
        Workspace room;
        if (!room.make([&](Arena &arena) { starts.lay_out(arena); })) return 1;
        starts.follow();
    }
    return 0;
}

Index follow_rows(const Robot &robot, const Constraints *constraints, const Motions *motions,
                  const Nodes *levels, const Settings &settings, const Exchange &exchange,
                  const Powers *powers, SearchProblem *problems, SamplingOptions *sampling, Index count) {
    const auto body_of = [&](Index) { return robot; };
    return follow_each<PlanarFlightEvaluator>(body_of, constraints, motions, levels, settings, exchange, powers, problems, sampling,
                                     count);
}

// The same of flights in space.
Index follow_in_space(const SpatialBody *bodies, const Cells *cells, const Constraints *constraints, const Motions *motions,
                      const Nodes *levels, const Settings &settings, const Exchange &exchange, const Powers *powers,
                      SearchProblem *problems, SamplingOptions *sampling, Index count) {
    const auto body_of = [&](Index row) { return SpatialFlightEvaluator::Body{bodies[row], cells, bodies[row].joints}; };
    return follow_each<SpatialFlightEvaluator>(body_of, constraints, motions, levels, settings, exchange, powers, problems, sampling,
                                      count);
}
