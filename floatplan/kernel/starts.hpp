// Starts by their numbers: number 0 is the x given; where h is free, the same x at other h takes turns with the first of
// the others. Each of these is the one of some random motions that violates (14) and the rows least.

// A class of motions that lands on other branches of the arcsine than another: odd ones mirror p about pi/2.
class BranchedMotions {
  public:
    Motions at;

    BranchedMotions(const Motions &plain, const double *offset_map, Index joints)
        : at(plain), plain(plain), offset_map(offset_map), n(joints), free(plain.first[joints]) {}

    void lay_out(Arena &arena) {
        arena.take(boundary, n * plain.given);
        arena.take(offset, free);
        arena.take(rates, plain.goal.knots * n);
        for (double **each : {&curvature, &bend}) arena.take(*each, n);
        at.boundary = boundary, at.offset = offset;
        if (plain.goal.knots) at.goal = {plain.goal.knots, plain.goal.momenta, rates, curvature, bend};
    }

    void land_on(const Index *branch) {
        copy(boundary, plain.boundary, n * plain.given);
        copy(offset, plain.offset, free);
        for (Index i = 0; i < n; ++i) {
            const double sign = branch[i] % 2 ? -1 : 1;
            double *own = boundary + i * plain.given;
            for (Index condition = 3; condition < 6; ++condition)
                if (plain.condition[condition] >= 0) own[plain.condition[condition]] *= sign;
            own[plain.condition[3]] += branch[i] * 3.141592653589793;
            for (Index knot = 0; knot < plain.goal.knots; ++knot)
                rates[knot * n + i] = sign * plain.goal.rates[knot * n + i];
            if (plain.goal.knots) curvature[i] = sign * plain.goal.curvature[i], bend[i] = sign * plain.goal.bend[i];
            for (Index r = plain.first[i]; offset_map && branch[i] && r < plain.first[i + 1]; ++r)
                offset[r] = dot(offset_map + r * plain.given, own, plain.given);
        }
    }

  private:
    const Motions &plain;
    const double *offset_map;
    Index n, free;
    double *boundary, *offset, *rates, *curvature, *bend;
};

template <typename Flight> class NumberedStarts {
  public:
    NumberedStarts(Program<Flight> &program, BranchedMotions &motions, const Exchange &rules, double bodies, Draws &draws,
                   Index joints)
        : program(program), motions(motions), rules(rules), bodies(bodies), draws(draws), n(joints),
          free(motions.at.first[joints]), size(motions.at.size) {}

    void lay_out(Arena &arena) {
        for (double **each : {&given, &z}) arena.take(*each, size);
        for (double **each : {&inverse, &matrix}) arena.take(*each, free * free);
    }

    // The x of number 0, of the class that is plain.
    void begin(const double *x) {
        copy(given, x, size);
        copy(matrix, motions.at.scaling, free * free);
        zero(inverse, free * free);
        for (Index k = 0; k < free; ++k) inverse[k * free + k] = 1;
        eliminate(matrix, inverse, free, free);
    }

    // Takes the class of a start and writes its x; whether it is one to follow straight to the objective.
    bool place(Index number, double *x) {
        const Index fractions = motions.at.axes ? draws.fractions : 0, beyond = number - 2 * fractions;
        const bool is_drawn = beyond > 0 || (number > 0 && number % 2 == 0);
        for (Index i = 0; i < n; ++i) draws.branch[i] = 0;
        if (is_drawn) {
            draw(beyond > 0 ? number - fractions - 1 : number / 2 - 1, x);
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
    const Exchange &rules;
    const double bodies;
    Draws &draws;
    Index n, free, size;
    double *given, *z, *inverse, *matrix;  // the last two of the scaling

    // Half of the motions are drawn in z, half are cheap for the objective, on the plain branches and on others in turns.
    void draw(Index number, double *x) {
        Random random{draws.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(number + 1)};
        for (Index i = 0; number % 2 && i < n; ++i) {
            const double drawn = random.uniform();
            draws.branch[i] = drawn < 0.25 ? -1 : drawn < 0.75 ? 0 : 1;
        }
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

// Starts followed one after the other, until one holds, or work has been done that the search is to know of; none where
// it is asked first whether any motion may hold, and the answer is no. What the most work ends is left out where it is
// not the first: how far it came hangs on what was done before.
template <typename Flight>
static inline Index follow_starts(const typename Flight::Body &body, const Constraints &constraints, const Motions &plain,
                                  const Nodes *levels, const Settings &settings, const Exchange &rules,
                                  const Powers *powers, Attempt &attempt, Draws &draws) {
    const Index joints = body.joints;
    BranchedMotions motions(plain, draws.offset_map, joints);
    Follower<Flight> follower(body, constraints, motions.at, levels, settings, rules, attempt);
    NumberedStarts<Flight> starts(follower.program, motions, rules, attempt.bodies, draws, joints);
    double *x, *best;
    Index *branch, level = 0, status = infeasible;
    Room room;
    auto lay_out = [&](Arena &arena) {
        motions.lay_out(arena);
        starts.lay_out(arena);
        follower.lay_out(arena);
        for (double **each : {&x, &best}) arena.take(*each, plain.size);
        arena.take(branch, joints);
    };
    if (!room.make(lay_out)) return 1;
    starts.begin(attempt.x);
    attempt.started = attempt.ends_hold = attempt.path_is_clear = 0;
    starts.place(0, x);
    learn_from_plain(follower.program, levels, settings, rules, attempt);
    const bool at_once = attempt.at_once;
    auto write = [&] {
        if (attempt.coefficients) follower.write(motions.at, *powers, joints, attempt.coefficients);
        if (attempt.objective_sums) attempt.objective = follower.finest_objective();
        attempt.at_once = at_once;
        return 0;
    };
    if (attempt.reach > 0 && attempt.first == 0 && !follower.may_hold(x))
        return follower.finish(x, attempt.level, infeasible), write();
    if (attempt.count == 0) return follower.judge_given(x), write();
    bool is_best = false;
    double least = HUGE_VAL;
    for (Index number = attempt.first; number < attempt.first + attempt.count; ++number) {
        const Attempt before = attempt;
        attempt.at_once = starts.place(number, x) && (number || at_once);
        if (attempt.started) follower.worth = larger(least, rules.near_miss);
        follower.follow(x);
        if (attempt.started && follower.program.work > attempt.most_work) {
            attempt = before, is_best = false;
            break;
        }
        is_best = !attempt.started++ || attempt.violation < least;
        if (is_best) {
            least = attempt.violation, level = attempt.judged_level, status = attempt.status;
            copy(best, attempt.x, plain.size);
            std::copy(draws.branch, draws.branch + joints, branch);
        }
        if (least <= 0 || follower.program.work > rules.enough_work) break;
    }
    if (!is_best) {
        std::copy(branch, branch + joints, draws.branch);
        motions.land_on(branch);
        follower.finish(best, level, status);
    }
    return write();
}

// So many problems of one robot, degrees and kinds of rows, each with starts of its own.
Index follow_rows(const Robot &robot, const Constraints *constraints, const Motions *motions,
                  const Nodes *levels, const Settings &settings, const Exchange &rules,
                  const Powers *powers, Attempt *attempts, Draws *draws, Index count) {
    for (Index row = 0; row < count; ++row)
        if (follow_starts<PlanarFlight>(robot, constraints[row], motions[row], levels, settings, rules, powers,
                                        attempts[row], draws[row]))
            return 1;
    return 0;
}

// The same of flights in space.
Index follow_in_space(const SpatialBody *bodies, const Cells *cells, const Constraints *constraints, const Motions *motions,
                      const Nodes *levels, const Settings &settings, const Exchange &rules, const Powers *powers,
                      Attempt *attempts, Draws *draws, Index count) {
    for (Index row = 0; row < count; ++row)
        if (follow_starts<SpatialFlight>({bodies[row], cells, bodies[row].joints}, constraints[row], motions[row], levels,
                                         settings, rules, powers, attempts[row], draws[row]))
            return 1;
    return 0;
}
