// Where the search begins: the plain motion; then, of many motions, those that promise the least objective.

// The boundary of a motion that lands on other branches of the arcsine: odd ones mirror p about pi/2.
static inline void branched(const double *boundary, const std::int64_t *branch, std::int64_t n, double *result) {
    std::memcpy(result, boundary, 6 * n * sizeof(double));
    for (std::int64_t i = 0; i < n; ++i) {
        double *end = result + 6 * i + 3;
        if (branch[i] % 2)
            for (int c = 0; c < 3; ++c) end[c] = -end[c];
        end[0] += branch[i] * 3.141592653589793;
    }
}

// Starts of one problem, in the order in which they are followed.
class Starts {
  public:
    Starts(Planner &planner, const Robot &robot, const Settings &settings, Memory &memory)
        : planner(planner), robot(robot), settings(settings), m(memory) {
        all_branches = 1;
        for (std::int64_t i = 0; i < robot.joints && all_branches <= settings.candidates; ++i) all_branches *= 3;
    }

    // Takes a problem, and the z that its start number 0 begins with; null: the plain motion's.
    void begin(const double *boundary, const double *given) {
        this->boundary = boundary;
        this->given = given;
        ranked = -1;
    }

    // Puts start number 0, 1, 2, ... into m.x. Of the first rounds of candidates those are followed that miss (14) least;
    // where these fail, all are.
    void follow(std::int64_t number) {
        if (number == 0) return first();
        std::int64_t round = (number - 1) / settings.followed;
        if (round >= settings.ranked_rounds) {
            draw(number + settings.ranked_rounds * (settings.candidates - settings.followed));
            return;
        }
        if (round != ranked) rank(round);
        ranked = round;
        draw(m.candidate[(number - 1) % settings.followed]);
    }

  private:
    Planner &planner;
    const Robot &robot;
    const Settings &settings;
    Memory &m;
    const double *boundary = nullptr, *given = nullptr;
    std::int64_t ranked = -1;   // round of candidates that are in order
    std::int64_t all_branches;  // 3^n, or more than there are candidates

    void first() {
        std::int64_t n = robot.joints;
        for (std::int64_t i = 0; i < n; ++i) m.branch[i] = 0;
        planner.set_boundary(boundary);
        for (std::int64_t e = 0; e < n * robot.width; ++e) m.z[e] = given ? given[e] : 0;
        planner.variables(m.z, m.x);
    }

    void draw(std::int64_t candidate) {
        std::int64_t n = robot.joints;
        Random random{settings.seed + 0x632be59bd9b4e019u * static_cast<std::uint64_t>(candidate)};
        std::int64_t digits = candidate % all_branches;
        for (std::int64_t i = 0; i < n; ++i, digits /= 3) {
            std::int64_t way = digits % 3;
            if (all_branches > settings.candidates) {
                double drawn = random.uniform() / settings.changed_branches;
                way = drawn < 0.5 ? 1 : drawn < 1 ? 2 : 0;
            }
            m.branch[i] = way == 2 ? -1 : way;
        }
        branched(boundary, m.branch, n, m.boundary);
        planner.set_boundary(m.boundary);
        double spread = candidate <= settings.candidates ? 0 : settings.spreads[candidate % 6];
        for (std::int64_t e = 0; e < n * robot.width; ++e) m.z[e] = spread * random.normal();
        planner.variables(m.z, m.x);
    }

    void rank(std::int64_t round) {
        for (std::int64_t place = 0; place < settings.candidates; ++place) {
            std::int64_t candidate = 1 + round * settings.candidates + place;
            draw(candidate);
            double merit = missed();
            std::int64_t at = place;
            for (; at > 0 && m.merit[at - 1] > merit; --at) {
                m.merit[at] = m.merit[at - 1];
                m.candidate[at] = m.candidate[at - 1];
            }
            m.merit[at] = merit;
            m.candidate[at] = candidate;
        }
    }

    // By how much (14) is missed after one step towards where it would hold, were it linear.
    double missed() {
        planner.at_level(settings.level_of_starts);
        for (std::int64_t step = 0; step < settings.steps_to_rank; ++step) {
            Point point = planner.evaluate(m.x);
            planner.differentiate(point, m.row);
            double square = dot(m.row, m.row, planner.size);
            if (!(square > 0)) return HUGE_VAL;
            double part = (dot(m.row, m.x, planner.size) - point.equality) / square;
            for (std::int64_t k = 0; k < planner.size; ++k) m.direction[k] = part * m.row[k] - m.x[k];
            double way = larger(planner.metric(m.direction), 1e-300);
            double length = smaller(1.0, settings.step_to_rank / way);
            for (std::int64_t k = 0; k < planner.size; ++k) m.x[k] += length * m.direction[k];
        }
        double missed = std::fabs(planner.evaluate(m.x).equality);
        return planner.unresolved() > settings.too_wild ? HUGE_VAL : missed;
    }
};
