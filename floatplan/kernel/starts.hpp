// Starts by their numbers: number 0 is the x given; where h is free, the same x at other h takes turns with the first of
// the others. Each of these is the one of some random motions that violates (14) and the rows least; without rows they are
// those of ranked.hpp.

template <typename Flight> class NumberedStarts {
  public:
    NumberedStarts(Program<Flight> &program, BranchedMotions &motions, const Settings &settings, const Exchange &rules,
                   double bodies, Draws &draws, Index joints)
        : program(program), motions(motions), ranked(program, motions, settings, draws, joints), rules(rules),
          bodies(bodies), draws(draws), n(joints), free(motions.at.first[joints]), size(motions.at.size) {}

    void lay_out(Arena &arena) {
        for (double **each : {&given, &z}) arena.take(*each, size);
        for (double **each : {&inverse, &matrix}) arena.take(*each, free * free);
        ranked.lay_out(arena);
    }

    // The x of number 0, of the class that is plain.
    void begin(const double *x) {
        copy(given, x, size);
        has_inverse = false;
    }

    // Takes the class of a start and writes its x; whether it is one to follow straight to the objective.
    bool place(Index number, double *x) {
        const Index fractions = motions.at.axes ? draws.fractions : 0, beyond = number - 2 * fractions;
        const bool is_drawn = beyond > 0 || (number > 0 && number % 2 == 0);
        for (Index i = 0; i < n; ++i) draws.branch[i] = 0;
        if (is_drawn) {
            const Index drawn = beyond > 0 ? number - fractions - 1 : number / 2 - 1;
            program.turns_alone ? ranked.draw(drawn, x) : draw(drawn, x);
        } else {
            motions.land_on(draws.branch);
            copy(x, given, size);
            if (number) x[free] = draws.fraction[number / 2];
        }
        return !is_drawn;
    }

  private:
    Program<Flight> &program;
    BranchedMotions &motions;
    RankedStarts<Flight> ranked;
    const Exchange &rules;
    const double bodies;
    Draws &draws;
    Index n, free, size;
    bool has_inverse = false;
    double *given, *z, *inverse, *matrix;  // the last two of the scaling

    void find_inverse() {
        has_inverse = true;
        copy(matrix, motions.at.scaling, free * free);
        zero(inverse, free * free);
        for (Index k = 0; k < free; ++k) inverse[k * free + k] = 1;
        eliminate(matrix, inverse, free, free);
    }

    // Half of the motions are drawn in z, half are cheap for the objective, on the plain branches and on others in turns.
    void draw(Index number, double *x) {
        Random random{draws.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(number + 1)};
        for (Index i = 0; number % 2 && i < n; ++i) {
            const double drawn = random.uniform();
            draws.branch[i] = drawn < 0.25 ? -1 : drawn < 0.75 ? 0 : 1;
        }
        if (!has_inverse) find_inverse();
        motions.land_on(draws.branch);
        program.back_off = 0;
        program.watches = true;
        program.watch(draws.level, nullptr, 0);
        Evaluated<Flight> &at = program.two[0];
        double least = HUGE_VAL;
        for (Index k = 0; k < draws.random; ++k) {
            const double spread = draws.spreads[k / 2 % 6];
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
        const double instants = draws.random * program.nodes();
        program.work += rules.evaluation + instants * bodies;  // all of them together
    }
};

// Starts followed one after the other; none where it is asked first whether any motion may hold, and the answer is no.
//
// Where so many solutions are wanted, it goes on until there are, and until more of them promise little: the plain motion
// was solved quickly, or several were found. It gives up where starts end equally far from the goal, and none nearer.
// Else it ends with the first that holds, or when work has been done that the search is to know of. What the most work
// ends is left out where it is not the first: how far it came hangs on what was done before.
template <typename Flight> class FollowedStarts {
  public:
    FollowedStarts(const typename Flight::Body &body, const Constraints &constraints, const Motions &plain,
                   const Nodes *levels, const Settings &settings, const Exchange &rules, const Powers *powers,
                   Attempt &attempt, Draws &draws)
        : joints(body.joints), columns(plain.columns), size(plain.size), motions(plain, draws.offset_map, body.joints),
          follower(body, constraints, motions.at, levels, settings, rules, attempt),
          starts(follower.program, motions, settings, rules, attempt.bodies, draws, body.joints), levels(levels),
          set(settings), rules(rules), powers(powers), attempt(attempt), draws(draws) {}

    void lay_out(Arena &arena) {
        motions.lay_out(arena);
        starts.lay_out(arena);
        follower.lay_out(arena);
        for (double **each : {&x, &best}) arena.take(*each, size);
        arena.take(b, joints * columns);
        arena.take(branch, joints);
    }

    void follow() {
        starts.begin(attempt.x);
        attempt.started = attempt.solved = attempt.ends_hold = attempt.path_is_clear = 0;
        starts.place(0, x);
        learn_from_plain(follower.program, levels, set, rules, attempt);
        const bool at_once = attempt.at_once;
        if (attempt.reach > 0 && attempt.first == 0 && !follower.may_hold(x)) {
            follower.finish(x, attempt.level, infeasible);
        } else if (!attempt.count) {
            follower.judge_given(x);
        } else {
            follow_all(at_once);
            if (!is_best) take_best();
        }
        if (attempt.coefficients && !attempt.wanted) follower.write(motions.at, *powers, joints, attempt.coefficients);
        if (attempt.objective_sums) attempt.objective = follower.finest_objective();
        attempt.at_once = at_once;
    }

  private:
    const Index joints, columns, size;
    BranchedMotions motions;
    Follower<Flight> follower;
    NumberedStarts<Flight> starts;
    const Nodes *levels;
    const Settings &set;
    const Exchange &rules;
    const Powers *powers;
    Attempt &attempt;
    Draws &draws;
    double *x, *b;                                  // of the start that is followed
    double *best;                                   // x of the best one, and what else is kept of that
    Index *branch, level = 0, status = infeasible;
    double least = HUGE_VAL, cost = HUGE_VAL;       // least: violation; cost: |b|
    double missed[3] = {};
    double nearest = HUGE_VAL;                      // least violation of all, and how many starts ended with that
    Index as_near = 0;
    bool is_best = false, is_easy = false;          // of the last one; whether the plain motion was solved quickly

    void follow_all(bool at_once) {
        for (Index number = attempt.first; number < attempt.first + attempt.count; ++number) {
            const Attempt before = attempt;
            attempt.at_once = starts.place(number, x) && (number || at_once);
            if (attempt.started) follower.worth = larger(least, rules.near_miss);
            if (number) follower.leave_hopeless();
            follower.follow(x);
            if (attempt.started && follower.program.work > attempt.most_work) {
                attempt = before;
                is_best = false;
                break;
            }
            const bool holds = attempt.violation <= 0;
            attempt.solved += holds;
            is_easy |= !number && holds && attempt.status == optimal && attempt.iterations <= set.easy_iterations;
            is_best = compare(holds);
            ++attempt.started;
            if (is_best) keep();
            if (attempt.wanted ? are_enough(number) : least <= 0 || follower.program.work > rules.enough_work) break;
        }
    }

    // Whether where a start ended is the best so far: it violates least, or of several that hold has the least |b|.
    bool compare(bool holds) {
        const bool is_nearer = !attempt.started || attempt.violation < least;
        if (!attempt.wanted || !(is_nearer || holds)) return is_nearer;
        follower.write(motions.at, *powers, joints, b);
        attempt.objective = std::sqrt(dot(b, b, joints * columns));
        return is_nearer || attempt.objective < cost;
    }

    void keep() {
        least = attempt.violation;
        copy(missed, attempt.missed, 3);
        cost = attempt.objective;
        level = attempt.judged_level;
        status = attempt.status;
        copy(best, attempt.x, size);
        std::copy(draws.branch, draws.branch + joints, branch);
        if (attempt.wanted) copy(attempt.coefficients, b, joints * columns);
    }

    void take_best() {
        std::copy(branch, branch + joints, draws.branch);
        motions.land_on(branch);
        if (!attempt.wanted) return follower.finish(best, level, status);
        copy(attempt.x, best, size);
        attempt.violation = least;
        copy(attempt.missed, missed, 3);
        attempt.objective = cost;
        attempt.judged_level = level;
        attempt.status = status;
    }

    bool are_enough(Index number) {
        if (!size) return true;  // there is but one motion
        const double left = attempt.violation;
        if (left < nearest * (1 - set.agreement)) as_near = 0;
        if (left < nearest * (1 + set.agreement)) ++as_near;
        nearest = smaller(nearest, left);
        if (!attempt.solved) return number >= set.starts_to_agree && as_near >= set.agreeing;
        return attempt.solved >= attempt.wanted && (is_easy || attempt.solved >= set.wanted_after_failure);
    }
};

// So many problems of one robot, degrees and kinds of rows, each with starts of its own; what flies is told by row.
template <typename Flight, typename BodyOf>
static inline Index follow_each(BodyOf body_of, const Constraints *constraints, const Motions *motions,
                                const Nodes *levels, const Settings &settings, const Exchange &rules,
                                const Powers *powers, Attempt *attempts, Draws *draws, Index count) {
    for (Index row = 0; row < count; ++row) {
        const typename Flight::Body body = body_of(row);
        FollowedStarts<Flight> starts(body, constraints[row], motions[row], levels, settings, rules, powers,
                                      attempts[row], draws[row]);
        Room room;
        if (!room.make([&](Arena &arena) { starts.lay_out(arena); })) return 1;
        starts.follow();
    }
    return 0;
}

Index follow_rows(const Robot &robot, const Constraints *constraints, const Motions *motions,
                  const Nodes *levels, const Settings &settings, const Exchange &rules,
                  const Powers *powers, Attempt *attempts, Draws *draws, Index count) {
    const auto body_of = [&](Index) { return robot; };
    return follow_each<PlanarFlight>(body_of, constraints, motions, levels, settings, rules, powers, attempts, draws,
                                     count);
}

// The same of flights in space.
Index follow_in_space(const SpatialBody *bodies, const Cells *cells, const Constraints *constraints, const Motions *motions,
                      const Nodes *levels, const Settings &settings, const Exchange &rules, const Powers *powers,
                      Attempt *attempts, Draws *draws, Index count) {
    const auto body_of = [&](Index row) { return SpatialFlight::Body{bodies[row], cells, bodies[row].joints}; };
    return follow_each<SpatialFlight>(body_of, constraints, motions, levels, settings, rules, powers, attempts, draws,
                                      count);
}
