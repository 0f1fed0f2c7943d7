// One start followed to its end, by the exchange method of semi-infinite programming (Hettich and Kortanek, SIAM Review 35
// (1993), section 7): the program at some instants is solved; where rows are low between them, instants join, until none is
// violated; nodes become more as the motion asks for them.

template <typename Flight> class Follower {
  public:
    Follower(const typename Flight::Body &body, const Constraints &constraints, const Motions &motions, const Nodes *levels,
             const Settings &settings, const Exchange &exchange, SearchProblem &problem)
        : program(body, constraints, motions, levels, settings, exchange, problem),
          search(program, settings, exchange, problem), settings(settings), exchange(exchange), problem(problem),
          most_nodes(levels[settings.levels - 1].nodes), has_rows(problem.rows > 0) {}

    void lay_out(Arena &arena) {
        const Index most = most_nodes + exchange.most_instants;
        program.lay_out(arena, most_nodes);
        search.lay_out(arena, problem.rows * ((most + 7) / 8 * 8));
        for (double **each : {&extra, &watched}) arena.take(*each, 2 * exchange.most_instants + problem.minima.instants);
        for (double **each : {&start, &restored, &best, &looked_at}) arena.take(*each, program.size);
    }

    Program<Flight> program;
    double worth = HUGE_VAL;  // of violation: by how much more an end violates the rows is not told

    // Of the starts from now on those are left soon from which there is next to no way to the goal.
    void leave_hopeless() {
        if (program.uses_adjoint) search.farthest = settings.hopeless_way / program.largest_metric();
    }

    // From x, once more from its end where that nearly holds, or is not known to be optimal.
    void follow(const double *x) {
        copy(best, x, program.size);
        problem.violation = HUGE_VAL;
        looked_level = -1;
        follow_best();
        if (problem.violation < exchange.near_miss && problem.status != optimal && !search.is_exhausted()) {
            problem.at_once = 1;
            follow_best();
        }
        problem.iterations = search.iterations;
        problem.evaluations = program.evaluations;
        problem.work = program.work;
        if (!is_best && problem.violation <= worth) {  // what is done again does not count
            finish(best, problem.violation < HUGE_VAL ? problem.judged_level : 0, problem.status);
            program.evaluations = problem.evaluations;
            program.work = problem.work;
        }
        copy(problem.x, best, program.size);
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
        begin(settings.levels - 1, search.now->x);
        return problem.objective_scale * search.now->objective;
    }

    // Whether nothing tells at x already that no motion holds.
    bool may_hold(const double *x) {
        program.watches = false;
        begin(problem.level, x);
        const Chance chance = program.chance(*search.now);
        problem.ends_hold = chance.ends_hold;
        problem.path_is_clear = chance.path_is_clear;
        return chance.ends_hold && chance.path_holds;
    }

    // Judges x as it is.
    void judge_given(const double *x) {
        copy(best, x, program.size);
        program.watches = has_rows;
        problem.violation = HUGE_VAL;
        status = infeasible;
        looked_level = -1;
        begin(problem.level, x);
        judge();
        copy(problem.x, best, program.size);
        problem.evaluations = program.evaluations;
        problem.work = program.work;
    }

    // Judges again where a start ended, with nodes of that level.
    void finish(const double *x, Index level, Index ended_as) {
        copy(problem.x, x, program.size);
        status = static_cast<Status>(ended_as);
        problem.violation = HUGE_VAL;
        looked_level = -1;
        judge_at(level, problem.x);
    }

  private:
    Sqp<Flight> search;
    const Settings &settings;
    const Exchange &exchange;
    SearchProblem &problem;
    Index most_nodes, extra_count = 0, looked_level = -1;  // the last: of the minima found last
    Status status = infeasible;
    bool has_rows, is_best = false, is_bare = true;  // the last: no instants have joined those watched
    double objective = 0;  // of the best
    double left_between = 0;  // of rows between the instants: by how much the last look found the lowest one too low
    double *extra, *watched, *start, *restored, *best, *looked_at;

    // From the best motion so far, once more. Without rows straight to the objective: what (14) alone lacks, the steps of the
    // SQP mend as well as any others. With rows that is tried of a start that is made for it; where it fails, by way of a
    // feasible motion, and at last by way of the best motion without rows.
    void follow_best() {
        copy(start, best, program.size);
        is_best = false;
        program.watches = has_rows;
        if (problem.at_once || !has_rows) {
            solve(start, problem.level);
            judge();
        }
        if (!has_rows || is_over()) return;
        const Index level = problem.at_once ? problem.level : problem.closer_level;
        restore_and_solve(level);
        if (!problem.at_once || is_over()) return;
        program.watches = false;
        solve(start, level);
        program.watches = true;
        copy(start, search.now->x, program.size);
        restore_and_solve(level);
    }

    // From `start` to a motion that violates next to nothing, at the nodes of the search's level and then at a closer one,
    // and on to the objective where that promises something.
    void restore_and_solve(Index closer_level) {
        program.back_off = exchange.back_off;
        extra_count = 0;
        begin(problem.level, start);
        double squared = search.reduce_violations();
        if (closer_level != problem.level && !search.is_stuck && squared < exchange.nearly_promising) {
            begin(closer_level, search.now->x);
            squared = search.reduce_violations();
        }
        status = infeasible;
        if (squared < exchange.promising && !search.is_stuck) {
            copy(restored, search.now->x, program.size);
            solve(restored, closer_level);
        }
        judge();
    }

    bool is_over() const { return problem.violation <= 0 || search.is_exhausted(); }

    // Watches the nodes of a level, the instants that always are, and those that have joined; evaluates x there.
    void begin(Index level, const double *x) {
        Index count = 0;
        for (const double *from : {problem.instants, (const double *)extra})
            for (Index k = 0; k < (from == extra ? extra_count : problem.fixed); ++k) watched[count++] = from[k];
        is_bare = !extra_count;
        std::sort(watched, watched + count);
        count = std::unique(watched, watched + count) - watched;
        program.watch(level, watched, count < exchange.most_instants ? count : exchange.most_instants);
        if (x != search.now->x) copy(search.now->x, x, program.size);
        program.evaluate(*search.now);
    }

    // Minimises the objective subject to (14) and to the rows at all times, in rounds: an SQP at the nodes and instants at
    // hand, then more nodes where these do not resolve where it ended, and instants where rows are low between them.
    void solve(const double *x, Index first_level) {
        program.back_off = exchange.back_off;
        extra_count = 0;
        Index level = begin_resolved(x, first_level);
        if (!program.is_known(*search.now)) {
            status = infeasible;
            return;
        }
        program.scale_equalities(*search.now);
        program.guess_hessian(*search.now, search.hessian);
        const Index begun = search.iterations;
        left_between = 0;
        Index stages[3] = {0, 2};
        const Index last = has_rows ? 1 : choose_stages(level, stages);
        Index stage = 0;
        for (Index round = 0; round < settings.most_rounds; ++round) {
            const bool is_last = stage == last;
            const bool is_free = !program.watches && problem.at_once;
            const double longest = is_free ? exchange.longest_free_step : settings.longest_step;
            Stage own = settings.stages[stages[stage]];
            const double rough = is_last ? exchange.between_left * left_between : 0;
            const bool is_rough = rough > own.feasibility;
            if (is_rough) own.feasibility = rough;
            status = search.minimise(own, longest, is_last);
            if (program.watches && status == infeasible && search.now->worst < settings.hopeless) make_feasible();
            if (!is_last) ++stage;
            const double error = settings.stages[stages[stage]].quadrature_error;
            const Index needed = std::max(level, program.level_needed(*search.now, error));
            bool finished = is_last && needed == level && !(is_rough && search.now->worst > program.back_off / 4);
            if (search.iterations - begun > settings.most_iterations) return;
            if (status == infeasible && (is_last || !(search.now->worst <= settings.hopeless))) {
                // What nearly holds may have no room inside its limits, but just as much as they leave.
                if (!(program.watches && program.back_off > 0 && search.now->worst < exchange.tight)) return;
                program.back_off = 0;
                finished = false;
            }
            if (needed > level) {
                level = needed;
                begin(level, search.now->x);
            }
            if (program.watches) finished &= look_between();
            if (finished) return;
            if (program.watches) begin(level, search.now->x);
            program.scale_equalities(*search.now);
        }
    }

    // Evaluates x at the first level from one on whose nodes resolve it coarsely, which is returned.
    Index begin_resolved(const double *x, Index level) {
        level = std::max(level, has_rows ? exchange.cheap_level : settings.first_level);
        begin(level, x);
        while (!(program.unresolved(*search.now) < settings.coarsely_resolved) && level + 1 < settings.levels) {
            ++level;
            begin(level, search.now->x);
        }
        return level;
    }

    // Without rows, what is solved before there are nodes enough: roughly, and nearly. The place of the last stage.
    Index choose_stages(Index level, Index *stages) const {
        Index count = 0;
        for (Index stage : {0, 1}) {
            const double error = settings.stages[stage ? 2 : 0].quadrature_error;
            if (program.level_needed(*search.now, error) > level) stages[count++] = stage;
        }
        stages[count] = 2;
        return count;
    }

    // Gives up the objective of a nearly feasible motion to make it feasible, where that can be done.
    void make_feasible() {
        const double square = search.now->worst * search.now->worst;
        copy(restored, search.now->x, program.size);
        if (!(search.reduce_violations() <= square)) {
            copy(search.now->x, restored, program.size);
            program.evaluate(*search.now);
            return;
        }
        const bool turned = program.missed(*search.now) <= settings.tolerance / 2;
        status = turned && search.now->worst <= program.back_off / 4 ? feasible : infeasible;
    }

    // Finds the local minima of the rows, unless they are those found last. Where all are high enough, a closer look has the
    // last word.
    void look() {
        const double *x = search.now->x;
        if (program.level == looked_level && std::equal(x, x + program.size, looked_at)) return;
        copy(looked_at, x, program.size);
        looked_level = program.level;
        Minima &minima = problem.minima;
        program.look(*search.now, minima);
        const auto enough = [this](Index row) { return exchange.inside_enough * room_inside(row); };
        for (Index found = 0; found < minima.found; ++found)
            if (minima.value[found] < enough(minima.row[found])) return;
        program.look_closer(*search.now, minima, enough);
    }

    // How far inside its limit a row is to be between the instants; below 0, what it may be outside.
    double room_inside(Index row) const { return program.back_off > 0 ? program.back_off : -problem.tolerance[row]; }

    // Whether no row is nearer to its limit between the instants; those where one is low join, and of the ones that had
    // joined before those stay that are beside a new one.
    bool look_between() {
        Minima &minima = problem.minima;
        look();
        bool holds = true;
        Index news = 0;
        left_between = 0;
        for (Index found = 0; found < minima.found; ++found) {
            const double s = minima.s[found], value = minima.value[found];
            if (!(s > exchange.near_end && s < 1 - exchange.near_end)) continue;
            const double room = room_inside(minima.row[found]);
            if (value < exchange.inside_enough * room) holds = false;
            left_between = larger(left_between, exchange.inside_enough * room - value);
            if (value < exchange.watched && news < exchange.most_instants) watched[news++] = s;
        }
        const Index all = news;
        for (Index k = 0; k < extra_count && all; ++k) {
            bool near = false;
            for (Index j = 0; j < all; ++j) near |= std::fabs(extra[k] - watched[j]) < exchange.beside;
            if (near && news < 2 * exchange.most_instants) watched[news++] = extra[k];
        }
        std::sort(watched, watched + news);
        extra_count = 0;
        for (Index k = 0; k < news; ++k)
            if ((k == 0 || watched[k] - watched[k - 1] > exchange.same_instant) && extra_count < exchange.most_instants)
                extra[extra_count++] = watched[k];
        return holds;
    }

    // Checks (14) and the rows, between the instants too; keeps what violates least, of equals what costs less, or is known
    // to be optimal.
    void judge() {
        Index level = program.level_needed(*search.now, settings.stages[2].quadrature_error);
        if (!has_rows) level = std::min(std::max(level, program.level) + settings.finer, settings.levels - 1);
        judge_at(level < problem.level ? problem.level : level, search.now->x);
    }

    void judge_at(Index level, const double *x) {
        level = evaluate_to_judge(level, x);
        const Evaluated<Flight> &now = *search.now;
        const double missed = program.unresolved(now) <= settings.unresolved ? program.missed(now) : HUGE_VAL;
        const double at_instants = larger(missed, now.worst - program.back_off);
        // Between the instants nothing is looked at that is no candidate already. The work of a start must not hang on the
        // others: a look counts alike, whether it is taken or not.
        const bool is_candidate = !(at_instants > smaller(worth, larger(problem.violation, exchange.near_miss)));
        const double work = program.work + exchange.evaluation + problem.minima.instants * problem.bodies;
        if (is_candidate) look();
        program.work = work;
        is_best = false;
        if (!is_candidate) {
            problem.violation = smaller(problem.violation, at_instants);
            return;
        }
        const double violation = largest_violation(missed);
        is_best = is_better(violation, now.objective);
        if (!is_best) return;
        copy(best, now.x, program.size);
        problem.violation = violation;
        copy(problem.missed, now.lacking, Flight::most_equalities);
        problem.judged_level = level;
        objective = now.objective;
        problem.status = violation <= 0 && status == infeasible ? feasible : status;
    }

    // Evaluates x at the nodes of a level, or of the first one after it that resolves the motion, which is returned. Nothing
    // is evaluated twice: x may have been evaluated there, with its rows and without instants that have joined.
    Index evaluate_to_judge(Index level, const double *x) {
        const bool watches = has_rows && worth < HUGE_VAL;
        const bool is_evaluated = program.level == level && x == search.now->x;
        const bool has_values = !watches || (program.watches && is_bare);
        extra_count = 0;
        if (!is_evaluated || !has_values) {
            program.watches = watches;
            begin(level, x);
        }
        while (program.unresolved(*search.now) > settings.unresolved && level + 1 < settings.levels) {
            ++level;
            begin(level, search.now->x);
        }
        program.watches = has_rows;
        return level;
    }

    // 0 where (14) and all rows hold, between the instants too, within their tolerances.
    double largest_violation(double missed) const {
        double violation = missed <= settings.tolerance ? 0 : missed;
        const Minima &minima = problem.minima;
        for (Index minimum = 0; minimum < minima.found; ++minimum) {
            const double value = minima.value[minimum];
            if (value < -problem.tolerance[minima.row[minimum]]) violation = larger(violation, -value);
        }
        return violation;
    }

    bool is_better(double violation, double cost) const {
        if (violation < problem.violation || !(problem.violation < HUGE_VAL)) return true;
        if (violation != problem.violation) return false;
        const double dearer = cost - objective;
        return dearer < 0 || (status == optimal && dearer <= exchange.same * std::fabs(objective));
    }
};
