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
        arena.take(inverse, free * free);
        arena.take(matrix, size * size);
        arena.take(branches, n);
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
    bool has_inverse = false;
    Index *branches;
    double *given, *z, *inverse, *matrix;  // the last two of the scaling

    void find_inverse() {
        has_inverse = true;
        copy(matrix, motions.at.scaling, free * free);
        zero(inverse, free * free);
        for (Index k = 0; k < free; ++k) inverse[k * free + k] = 1;
        eliminate(matrix, inverse, free, free);
    }

    // Without rows: of some motions on branches of their own, the one that is nearest to the goal after a few steps.
    void draw_branches(Index number, double *x) {
        program.watch(draws.level, nullptr, 0);
        Evaluated<Flight> &at = program.two[0];
        double least = HUGE_VAL;
        Index *chosen = branches;
        const Index among = number < draws.ranked ? draws.random : 1;
        const Index first = 1 + (number < draws.ranked ? number * among : draws.ranked * (draws.random - 1) + number);
        for (Index k = 0; k < among; ++k) {
            choose(first + k, at);
            const double missed = among > 1 ? approach(at) : 0;
            if (k && !(missed < least)) continue;
            least = missed;
            copy(x, at.x, size);
            std::copy(draws.branch, draws.branch + n, chosen);
        }
        std::copy(chosen, chosen + n, draws.branch);
        motions.land_on(draws.branch);
    }

    void choose(Index candidate, Evaluated<Flight> &at) {
        Random random{draws.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(candidate)};
        Index all_branches = 1, digits = candidate;
        for (Index i = 0; i < n && all_branches <= 12; ++i) all_branches *= 3;
        digits = candidate % all_branches;
        for (Index i = 0; i < n; ++i, digits /= 3) {
            Index way = digits % 3;
            if (all_branches > 12) {
                const double drawn = random.uniform() / 0.8;
                way = drawn < 0.5 ? 1 : drawn < 1 ? 2 : 0;
            }
            draws.branch[i] = way == 2 ? -1 : way;
        }
        motions.land_on(draws.branch);
        const double spreads[] = {0.2, 0.4, 0.8, 1.6, 0.8, 1.6};
        const double spread = candidate <= 12 ? 0 : spreads[candidate % 6];
        for (Index i = 0; i < free; ++i) z[i] = spread * random.normal() - motions.at.offset[i];
        multiply(inverse, free, free, z, 1, at.x);
        for (Index a = free; a < size; ++a) at.x[a] = 2 * random.uniform() - 1;
    }

    // By how much (14) is missed after some steps towards where it would hold, were it linear, nearest to x = 0.
    double approach(Evaluated<Flight> &at) {
        double *step = matrix;
        for (Index k = 0; k < 3; ++k) {
            program.evaluate(at);
            program.differentiate(at);
            const double square = dot(at.row, at.row, size);
            if (!(square > 0)) return HUGE_VAL;
            const double part = (dot(at.row, at.x, size) - at.equality[0]) / square;
            for (Index a = 0; a < size; ++a) step[a] = part * at.row[a] - at.x[a];
            add(smaller(1.0, 1 / larger(program.metric(step), 1e-300)), step, size, at.x);
        }
        program.evaluate(at);
        return program.unresolved(at) > 0.3 ? HUGE_VAL : std::fabs(at.equality[0]);
    }

    // Half of the motions are drawn in z, half are cheap for the objective, on the plain branches and on others in turns.
    void draw(Index number, double *x) {
        Random random{draws.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(number + 1)};
        for (Index i = 0; number % 2 && i < n; ++i) {
            const double drawn = random.uniform();
            draws.branch[i] = drawn < 0.25 ? -1 : drawn < 0.75 ? 0 : 1;
        }
        if (!has_inverse) find_inverse();
        if (program.turns_alone) return draw_branches(number, x);
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
          starts(follower.program, motions, rules, attempt.bodies, draws, body.joints), levels(levels), set(settings),
          rules(rules), powers(powers), attempt(attempt), draws(draws) {}

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
    Index *branch, level = 0, status = infeasible;  // of the best
    double least = HUGE_VAL, missed = 0, cost = HUGE_VAL, nearest = HUGE_VAL;
    Index as_near = 0;   // starts that ended as near to the goal as any
    bool is_best = false, is_easy = false;
    double *x, *best, *b;

    void follow_all(bool at_once) {
        for (Index number = attempt.first; number < attempt.first + attempt.count; ++number) {
            const Attempt before = attempt;
            attempt.at_once = starts.place(number, x) && (number || at_once);
            if (attempt.started) follower.worth = larger(least, rules.near_miss);
            follower.follow(x);
            if (attempt.started && follower.program.work > attempt.most_work) {
                attempt = before, is_best = false;
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
        least = attempt.violation, level = attempt.judged_level, status = attempt.status;
        missed = attempt.missed, cost = attempt.objective;
        copy(best, attempt.x, size);
        std::copy(draws.branch, draws.branch + joints, branch);
        if (attempt.wanted) copy(attempt.coefficients, b, joints * columns);
    }

    void take_best() {
        std::copy(branch, branch + joints, draws.branch);
        motions.land_on(branch);
        if (!attempt.wanted) return follower.finish(best, level, status);
        copy(attempt.x, best, size);
        attempt.violation = least, attempt.missed = missed, attempt.objective = cost;
        attempt.status = status, attempt.judged_level = level;
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

// So many problems of one robot, degrees and kinds of rows, each with starts of its own.
template <typename Flight>
static inline Index follow_each(const typename Flight::Body &body, const Constraints *constraints, const Motions *motions,
                                const Nodes *levels, const Settings &settings, const Exchange &rules,
                                const Powers *powers, Attempt *attempts, Draws *draws, Index count) {
    for (Index row = 0; row < count; ++row) {
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
    return follow_each<PlanarFlight>(robot, constraints, motions, levels, settings, rules, powers, attempts, draws, count);
}
