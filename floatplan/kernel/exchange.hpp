// One start followed to its end, by the exchange method of semi-infinite programming (Hettich and Kortanek, SIAM Review 35
// (1993), section 7): the program at some instants is solved; where rows are low between them, instants join, until none is
// violated; nodes become more as the motion asks for them.

template <typename Flight> class Follower {
  public:
    Follower(const typename Flight::Body &body, const Constraints &constraints, const Motions &motions, const Nodes *levels,
             const Settings &settings, const Exchange &rules, Attempt &attempt)
        : program(body, constraints, motions, levels, settings, rules, attempt),
          search(program, settings, rules, attempt), set(settings), rules(rules), attempt(attempt),
          most_nodes(levels[settings.levels - 1].nodes), has_rows(attempt.rows > 0) {}

    void lay_out(Arena &arena) {
        const Index most = most_nodes + rules.most_instants;
        program.lay_out(arena, most_nodes);
        search.lay_out(arena, attempt.rows * ((most + 7) / 8 * 8));
        for (double **each : {&extra, &watched}) arena.take(*each, 2 * rules.most_instants + attempt.minima.instants);
        for (double **each : {&start, &ended, &best, &looked_at}) arena.take(*each, program.size);
    }

    Program<Flight> program;
    double worth = HUGE_VAL;  // of violation: by how much more an end violates the rows is not told

    // Of the starts from now on those are left soon from which there is next to no way to the goal.
    void leave_hopeless() {
        if (program.turns_alone) search.farthest = set.hopeless_way / program.largest_metric();
    }

    // From x, once more from its end where that nearly holds, or is not known to be optimal.
    void follow(const double *x) {
        copy(best, x, program.size);
        attempt.violation = HUGE_VAL;
        looked_level = -1;
        follow_best();
        if (attempt.violation < rules.near_miss && attempt.status != optimal && !search.is_exhausted()) {
            attempt.at_once = 1;
            follow_best();
        }
        attempt.iterations = search.iterations;
        attempt.evaluations = program.evaluations;
        attempt.work = program.work;
        if (!is_best && attempt.violation <= worth) {  // what is done again does not count
            finish(best, attempt.violation < HUGE_VAL ? attempt.judged_level : 0, attempt.status);
            program.evaluations = attempt.evaluations, program.work = attempt.work;
        }
        copy(attempt.x, best, program.size);
    }

    // b of where it ended, in powers of seconds.
    void write(const Motions &motions, const Powers &powers, Index joints, double *b) const {
        Double2 time[MOST_COLUMNS] = {{1, 0}};
        double combination[MOST_COLUMNS];
        for (Index k = 1; k < motions.columns; ++k) time[k] = time[k - 1] * motions.duration;
        for (Index i = 0; i < joints; ++i, b += motions.columns) {
            for (Index c = 0; c < motions.columns; ++c) combination[c] = search.now->coefficients[c * joints + i];
            write_coefficients(combination, time, powers, motions.columns, b);
        }
    }

    // The objective of where it ended, as the nodes of the finest level tell.
    double finest_objective() {
        program.watches = false;
        begin(set.levels - 1, search.now->x);
        return attempt.objective_scale * search.now->objective;
    }

    // Whether nothing tells at x already that no motion holds.
    bool may_hold(const double *x) {
        program.watches = false;
        begin(attempt.level, x);
        const Chance chance = program.chance(*search.now);
        attempt.ends_hold = chance.ends_hold, attempt.path_is_clear = chance.path_is_clear;
        return chance.ends_hold && chance.path_holds;
    }

    // Judges x as it is.
    void judge_given(const double *x) {
        copy(best, x, program.size);
        program.watches = has_rows;
        attempt.violation = HUGE_VAL;
        status = infeasible;
        looked_level = -1;
        begin(attempt.level, x);
        judge();
        copy(attempt.x, best, program.size);
        attempt.evaluations = program.evaluations;
        attempt.work = program.work;
    }

    // Judges again where a start ended, with nodes of that level.
    void finish(const double *x, Index level, Index ended_as) {
        copy(attempt.x, x, program.size);
        status = static_cast<Status>(ended_as);
        attempt.violation = HUGE_VAL;
        looked_level = -1;
        judge_at(level, attempt.x);
    }

  private:
    Constrained<Flight> search;
    const Settings &set;
    const Exchange &rules;
    Attempt &attempt;
    Index most_nodes, extra_count = 0, looked_level = -1;  // the last: of the minima found last
    Status status = infeasible;
    bool has_rows, is_best = false, is_bare = true;  // the last: no instants have joined those watched
    double objective = 0;  // of the best
    double *extra, *watched, *start, *ended, *best, *looked_at;

    // Straight to the objective where it is a start for that, and by way of a feasible motion where that fails. Without
    // rows every start is: what (14) alone lacks, the steps of the SQP mend as well as any others.
    void follow_best() {
        copy(start, best, program.size);
        is_best = false;
        program.watches = has_rows;
        if (attempt.at_once || !has_rows) {
            solve(start, attempt.level);
            judge();
        }
        if (!has_rows) return;
        const Index level = attempt.at_once ? attempt.level : attempt.closer_level;
        for (int way = 0; way < 1 + attempt.at_once && !is_over(); ++way) {
            if (way == 1) {  // from the best motion without limits
                program.watches = false;
                solve(start, level);
                program.watches = true;
                copy(start, search.now->x, program.size);
            }
            program.back_off = rules.back_off;
            extra_count = 0;
            double left = HUGE_VAL;
            for (Index each : {attempt.level, level}) {
                begin(each, each == attempt.level ? start : search.now->x);
                left = search.reduce_violations();
                if (search.is_stuck || !(left < rules.nearly_promising) || attempt.level == level) break;
            }
            status = infeasible;
            if (left < rules.promising && !search.is_stuck) {
                copy(ended, search.now->x, program.size);
                solve(ended, level);
            }
            judge();
        }
    }

    bool is_over() const { return attempt.violation <= 0 || search.is_exhausted(); }

    // Watches the nodes of a level, the instants that always are, and those that have joined; evaluates x there.
    void begin(Index level, const double *x) {
        Index count = 0;
        for (const double *from : {attempt.instants, (const double *)extra})
            for (Index k = 0; k < (from == extra ? extra_count : attempt.fixed); ++k) watched[count++] = from[k];
        is_bare = !extra_count;
        std::sort(watched, watched + count);
        count = std::unique(watched, watched + count) - watched;
        program.watch(level, watched, count < rules.most_instants ? count : rules.most_instants);
        if (x != search.now->x) copy(search.now->x, x, program.size);
        program.evaluate(*search.now);
    }

    // Minimises the objective subject to (14) and to the rows at all times.
    void solve(const double *x, Index level) {
        program.back_off = rules.back_off;
        extra_count = 0;
        const Index cheap = has_rows ? rules.cheap_level : set.first_level;
        if (level < cheap) level = cheap;
        for (begin(level, x); !(program.unresolved(*search.now) < set.coarsely_resolved) && level + 1 < set.levels;)
            begin(++level, search.now->x);
        if (!program.is_known(*search.now)) {
            status = infeasible;
            return;
        }
        program.scale_equalities(*search.now);
        program.guess_hessian(*search.now, search.hessian);
        const Index before = search.iterations;
        Index stages[3] = {0, 2}, last = 1, stage = 0;
        if (!has_rows) last = choose_stages(level, stages);
        for (Index round = 0; round < set.most_rounds; ++round) {
            const bool is_last = stage == last;
            const bool is_free = !program.watches && attempt.at_once;
            const double longest = is_free ? rules.longest_free_step : set.longest_step;
            status = search.minimise(set.stages[stages[stage]], longest, is_last);
            if (program.watches && status == infeasible && search.now->worst < set.hopeless) make_feasible();
            if (!is_last) ++stage;
            Index needed = program.level_needed(*search.now, set.stages[stages[stage]].quadrature_error);
            if (needed < level) needed = level;
            bool finished = is_last && needed == level;
            if (search.iterations - before > set.most_iterations) break;
            if (status == infeasible && (is_last || !(search.now->worst <= set.hopeless))) {
                if (!(program.watches && program.back_off > 0 && search.now->worst < rules.tight)) break;
                program.back_off = 0;
                finished = false;
            }
            if (needed > level) begin(level = needed, search.now->x);
            if (program.watches && look_between() && finished) break;
            if (program.watches) begin(level, search.now->x);
            else if (finished) break;
            program.scale_equalities(*search.now);
        }
    }

    // Without rows, what is solved before there are nodes enough: roughly, and nearly. The place of the last stage.
    Index choose_stages(Index level, Index *stages) const {
        Index count = 0;
        for (Index stage : {0, 1}) {
            const double error = set.stages[stage ? 2 : 0].quadrature_error;
            if (program.level_needed(*search.now, error) > level) stages[count++] = stage;
        }
        stages[count] = 2;
        return count;
    }

    // Gives up the objective of a nearly feasible motion to make it feasible, where that can be done.
    void make_feasible() {
        const double square = search.now->worst * search.now->worst;
        copy(ended, search.now->x, program.size);
        if (!(search.reduce_violations() <= square)) {
            copy(search.now->x, ended, program.size);
            program.evaluate(*search.now);
            return;
        }
        const bool turned = program.missed(*search.now) <= set.tolerance / 2;
        status = turned && search.now->worst <= program.back_off / 4 ? feasible : infeasible;
    }

    // Finds the local minima of the rows, unless they are those found last.
    void look() {
        const double *x = search.now->x;
        if (program.level == looked_level && std::equal(x, x + program.size, looked_at)) return;
        copy(looked_at, x, program.size);
        looked_level = program.level;
        program.look(*search.now, attempt.minima);
    }

    // Whether no row is nearer to its limit between the instants; those where one is low join, and of the ones that had
    // joined before those stay that are beside a new one.
    bool look_between() {
        Minima &minima = attempt.minima;
        look();
        bool holds = true;
        Index news = 0;
        for (Index found = 0; found < minima.found; ++found) {
            const double s = minima.s[found], least = minima.least[found];
            if (!(s > rules.given && s < 1 - rules.given)) continue;
            const double room = program.back_off > 0 ? program.back_off : -attempt.tolerance[minima.row[found]];
            if (least < rules.inside_enough * room) holds = false;
            if (least < rules.watched && news < rules.most_instants) watched[news++] = s;
        }
        const Index all = news;
        for (Index k = 0; k < extra_count && all; ++k) {
            bool near = false;
            for (Index j = 0; j < all; ++j) near |= std::fabs(extra[k] - watched[j]) < rules.beside;
            if (near && news < 2 * rules.most_instants) watched[news++] = extra[k];
        }
        std::sort(watched, watched + news);
        extra_count = 0;
        for (Index k = 0; k < news; ++k)
            if ((k == 0 || watched[k] - watched[k - 1] > rules.same_instant) && extra_count < rules.most_instants)
                extra[extra_count++] = watched[k];
        return holds;
    }

    // Checks (14) and the rows, between the instants too; keeps what violates least, of equals what costs less, or is known
    // to be optimal.
    void judge() {
        Index level = program.level_needed(*search.now, set.stages[2].quadrature_error);
        if (!has_rows) level = std::min(std::max(level, program.level) + set.finer, set.levels - 1);
        judge_at(level < attempt.level ? attempt.level : level, search.now->x);
    }

    void judge_at(Index level, const double *x) {
        const bool watches = has_rows && worth < HUGE_VAL, is_there = program.level == level && x == search.now->x;
        if (!(is_there && (!watches || (program.watches && is_bare)))) {  // else nothing there is not known
            program.watches = watches;
            extra_count = 0;
            begin(level, x);
        }
        extra_count = 0;
        while (program.unresolved(*search.now) > set.unresolved && level + 1 < set.levels) begin(++level, search.now->x);
        const Evaluated<Flight> &now = *search.now;
        program.watches = has_rows;
        const double missed = program.unresolved(now) <= set.unresolved ? program.missed(now) : HUGE_VAL;
        const double known = larger(missed, now.worst - program.back_off);
        const double work = program.work + rules.evaluation + attempt.minima.instants * attempt.bodies;
        is_best = false;
        const bool tells = !(known > smaller(worth, larger(attempt.violation, rules.near_miss)));
        if (tells) look();
        program.work = work;  // what a start takes does not hang on the others
        if (!tells) return void(attempt.violation = smaller(attempt.violation, known));
        double violation = missed <= set.tolerance ? 0 : missed;
        for (Index found = 0; found < attempt.minima.found; ++found) {
            const double least = attempt.minima.least[found];
            if (least < -attempt.tolerance[attempt.minima.row[found]]) violation = larger(violation, -least);
        }
        const double dearer = now.objective - objective, same = rules.same * std::fabs(objective);
        is_best = violation < attempt.violation || !(attempt.violation < HUGE_VAL) ||
                  (violation == attempt.violation && (dearer < 0 || (status == optimal && dearer <= same)));
        if (!is_best) return;
        copy(best, now.x, program.size);
        attempt.violation = violation;
        copy(attempt.missed, now.lacking, Flight::most_equalities);
        attempt.judged_level = level;
        objective = now.objective;
        attempt.status = violation <= 0 && status == infeasible ? feasible : status;
    }
};
