// Starts of a program without rows, by their numbers: motions that land on branches of the arcsine of their own. In rounds
// of candidates each is moved some steps towards where (14) would hold, were it linear, nearest to the least objective;
// those that then miss (14) least are followed. After these rounds all are, as they are drawn.

template <typename Flight> class RankedStarts {
  public:
    RankedStarts(Program<Flight> &program, BranchedMotions &motions, const Settings &settings,
                 SamplingOptions &sampling, Index joints)
        : program(program), motions(motions), settings(settings), sampling(sampling), n(joints), size(motions.at.size) {
        for (Index i = 0; i < n && all_branches <= settings.candidates; ++i) all_branches *= 3;
    }

    void lay_out(Arena &arena) {
        arena.take(moved, settings.candidates * size);
        arena.take(missed, settings.candidates);
        arena.take(order, settings.candidates);
        for (double **each : {&z, &step}) arena.take(*each, size);
    }

    // Takes the class of motions of a start, number 0, 1, .., and writes its x.
    void draw(Index number, double *x) {
        const Index round = number / settings.followed;
        if (round >= settings.ranked_rounds)
            return choose(number + settings.ranked_rounds * (settings.candidates - settings.followed), x);
        if (round != ranked) rank(round);
        ranked = round;
        const Index place = order[number % settings.followed];
        choose(round * settings.candidates + place, x);
        copy(x, moved + place * size, size);
    }

  private:
    Program<Flight> &program;
    BranchedMotions &motions;
    const Settings &settings;
    SamplingOptions &sampling;
    const Index n, size;
    Index all_branches = 1;  // 3^n, or more than there are candidates
    Index ranked = -1;       // the round whose candidates are in order
    Index *order;            // (candidates): of the round, the nearest first
    double *moved, *missed;  // (candidates, size), (candidates)
    double *z, *step;

    // Takes the branches of a candidate, and writes its x. Where there are not more branches than candidates, each of these
    // has others; motions of the first round have no free part.
    void choose(Index candidate, double *x) {
        Random random{sampling.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(candidate + 1)};
        Index digits = (candidate + 1) % all_branches;
        for (Index i = 0; i < n; ++i, digits /= 3) {
            Index way = digits % 3;
            if (all_branches > settings.candidates) {
                const double drawn = random.uniform() / settings.changed_branches;
                way = drawn < 0.5 ? 1 : drawn < 1 ? 2 : 0;
            }
            sampling.branch[i] = way == 2 ? -1 : way;
        }
        motions.land_on(sampling.branch);
        const double spread = candidate < settings.candidates ? 0 : settings.spreads_of_starts[(candidate + 1) % 6];
        const Index free = motions.at.first[n];
        for (Index k = 0; k < free; ++k) z[k] = spread * random.normal();
        program.variables(z, x);
        for (Index a = free; a < size; ++a) x[a] = 2 * random.uniform() - 1;
    }

    void rank(Index round) {
        for (Index place = 0; place < settings.candidates; ++place) {
            double *x = moved + place * size;
            choose(round * settings.candidates + place, x);
            missed[place] = approach(x);
            order[place] = place;
        }
        std::stable_sort(order, order + settings.candidates, [&](Index a, Index b) { return missed[a] < missed[b]; });
    }

    // Moves x; by how much it misses (14) then.
    double approach(double *x) {
        program.watch(settings.level_of_starts, nullptr, 0);
        Evaluated<Flight> &at = program.two[0];
        copy(at.x, x, size);
        program.evaluate(at);
        for (Index k = 0; k < settings.steps_to_rank; ++k) {
            program.differentiate(at);
            const double square = dot(at.row, at.row, size);
            if (!(square > 0)) return HUGE_VAL;
            const double part = (dot(at.row, at.x, size) - at.equality[0]) / square;
            for (Index a = 0; a < size; ++a) step[a] = part * at.row[a] - at.x[a];
            add(smaller(1.0, settings.step_to_rank / larger(program.metric(step), 1e-300)), step, size, at.x);
            program.evaluate(at);
        }
        copy(x, at.x, size);
        return program.unresolved(at) > settings.too_wild ? HUGE_VAL : std::fabs(at.equality[0]);
    }
};
