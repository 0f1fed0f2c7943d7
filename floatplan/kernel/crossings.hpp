// Starts among random motions: theta0(T) is continuous in x, so that between a motion that turns too much and one that
// turns too little there is one that meets (14). Pairs of them are followed by the secant method, all together so many
// steps; of what they lead to that counts which violates the rows least, then the smallest.

class Crossings {
  public:
    Crossings(Program &program, Drawn &drawn) : program(program), drawn(drawn), size(program.size) {}

    void lay_out(Arena &arena) {
        const Index count = drawn.count;
        for (double **each : {&missed, &length}) arena.take(*each, count);
        for (Index **each : {&over, &under, &rank}) arena.take(*each, count);
        for (double **each : {&low, &high, &middle}) arena.take(*each, count * size);
        for (double **each : {&low_missed, &high_missed, &merit}) arena.take(*each, count);
    }

    void find() {
        drawn.found = 0;
        program.watches = false;
        for (Index k = 0; k < drawn.count; ++k) {
            missed[k] = miss(drawn.motions + k * size);
            length[k] = std::sqrt(dot(drawn.motions + k * size, drawn.motions + k * size, size));
        }
        const Index overs = rank_side(over, 1), unders = rank_side(under, -1);
        if (overs && unders) return cross(overs, unders);
        Index nearest = 0;  // where all turn too much, or all too little
        for (Index k = 1; k < drawn.count; ++k)
            if (std::fabs(missed[k]) < std::fabs(missed[nearest])) nearest = k;
        copy(drawn.starts, drawn.motions + nearest * size, size);
        drawn.found = 1;
    }

  private:
    Program &program;
    Drawn &drawn;
    Index size, *over, *under, *rank;
    double *missed, *length, *low, *high, *middle, *low_missed, *high_missed, *merit;

    double miss(const double *x) {
        Evaluated &at = program.two[0];
        copy(at.x, x, size);
        program.evaluate(at);
        return at.equality;
    }

    // The motions on one side of the goal, shorter ones first; how many.
    Index rank_side(Index *side, double sign) {
        Index count = 0;
        for (Index k = 0; k < drawn.count; ++k)
            if (sign * missed[k] > 0) side[count++] = k;
        std::stable_sort(side, side + count, [&](Index a, Index b) { return length[a] < length[b]; });
        return count;
    }

    void cross(Index overs, Index unders) {
        const Index pairs = overs > unders ? overs : unders;
        for (Index k = 0; k < pairs; ++k) {
            const Index a = over[k % overs], b = under[k % unders];
            copy(low + k * size, drawn.motions + a * size, size), low_missed[k] = missed[a];
            copy(high + k * size, drawn.motions + b * size, size), high_missed[k] = missed[b];
            rank[k] = k;
        }
        for (Index step = 0; step < drawn.steps; ++step) {
            program.watches = step + 1 == drawn.steps;
            for (Index k = 0; k < pairs; ++k) follow(k);
        }
        std::stable_sort(rank, rank + pairs, [&](Index a, Index b) { return merit[a] < merit[b]; });
        for (Index k = 0; k < pairs && drawn.found < drawn.most; ++k)
            if (is_apart(middle + rank[k] * size)) copy(drawn.starts + drawn.found++ * size, middle + rank[k] * size, size);
    }

    // One step of a pair's secant method.
    void follow(Index k) {
        double *from = low + k * size, *to = high + k * size, *x = middle + k * size;
        double share = low_missed[k] / (low_missed[k] - high_missed[k]);
        share = smaller(larger(share, drawn.least_share), 1 - drawn.least_share);
        for (Index i = 0; i < size; ++i) x[i] = from[i] + share * (to[i] - from[i]);
        const double left = miss(x);
        copy(left > 0 ? from : to, x, size);
        (left > 0 ? low_missed : high_missed)[k] = left;
        merit[k] = program.two[0].squares + 1e-9 * std::sqrt(dot(x, x, size));
        if (!(merit[k] < HUGE_VAL)) merit[k] = HUGE_VAL;
    }

    // Whether it is apart from all before: nearer ones lead to the same motion.
    bool is_apart(const double *x) {
        double *step = program.two[0].gradient;
        for (Index other = 0; other < drawn.found; ++other) {
            for (Index i = 0; i < size; ++i) step[i] = x[i] - drawn.starts[other * size + i];
            if (!(program.metric(step) > drawn.apart)) return false;
        }
        return true;
    }
};

static inline Index find_crossings(const Robot &robot, const Constraints &constraints, const Motions &motions,
                                   const Nodes *levels, const Settings &settings, const Exchange &rules,
                                   Attempt &attempt, Drawn &drawn) {
    Program program(robot, constraints, motions, levels, settings, rules, attempt);
    Crossings crossings(program, drawn);
    Room room, beside;
    if (!room.make([&](Arena &arena) { program.lay_out(arena, levels[attempt.level].nodes); })) return 1;
    if (!beside.make([&](Arena &arena) { crossings.lay_out(arena); })) return 1;
    program.back_off = 0;
    program.watch(attempt.level, nullptr, 0);
    crossings.find();
    const double instants = program.evaluations * program.nodes();
    attempt.work = (1 + drawn.steps) * rules.evaluation + instants * attempt.bodies;  // the motions of a step together
    return 0;
}
