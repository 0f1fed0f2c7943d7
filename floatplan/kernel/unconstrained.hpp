// Optima of the program without its rows, from the starts of ranked.hpp. Obstacles and limits break a search into many
// minima, most of them dear; without rows there are few, found in a fraction of the time, and one may keep to all the rows.

template <typename Flight> class UnconstrainedOptima {
  public:
    UnconstrainedOptima(const typename Flight::Body &body, const Constraints &constraints, BranchedMotions &motions,
                        const Nodes *levels, const Settings &settings, const Exchange &exchange,
                        const SearchProblem &constrained, SamplingOptions &sampling, Index joints)
        : problem(without_rows(constrained, settings)),
          follower(body, constraints, motions.at, levels, settings, exchange, problem),
          starts(follower.program, motions, settings, sampling, joints) {}

    void lay_out(Arena &arena) {
        arena.take(problem.x, follower.program.size);
        starts.lay_out(arena);
        follower.lay_out(arena);
    }

    // Takes the class of motions of a start, number 0, 1, .., and follows it: whether it has led to an optimum, which is then
    // written to x.
    bool find(Index number, double *x) {
        starts.draw(number, x);
        follower.leave_hopeless();
        follower.follow(x);
        copy(x, problem.x, follower.program.size);
        return problem.violation <= 0 && problem.status == optimal;
    }

    double work() const { return follower.program.work; }
    Index evaluations() const { return follower.program.evaluations; }
    const Follower<Flight> &last() const { return follower; }

  private:
    SearchProblem problem;
    Follower<Flight> follower;
    RankedStarts<Flight> starts;

    static SearchProblem without_rows(SearchProblem problem, const Settings &settings) {
        problem.rows = problem.fixed = problem.minima.instants = 0;
        problem.level = settings.first_level;
        problem.coefficients = problem.end_values = nullptr;
        return problem;
    }
};
