// The remaining flight under a motion of the joints: how the base turns, rows of constraints, and their derivatives.
//
// What it is in a plane and in space is a Remaining, of remaining_in_plane.hpp or remaining_in_space.hpp:
//
//     Body, Point, State   what flies; a point of its links; a motion of it, of whose joints motion_of() gives the Motion
//     equalities           numbers of a miss: (14), or in space the vector of rotation log(R_goal^T R_WB(T)), rad
//     begin                from the state that is estimated, for so many seconds
//     turn_base            what a motion misses the goal by; infinite where it cannot be integrated
//     move_links           what rows need beside
//     find_moments         what torques need, where rows do not need it
//     differentiate_miss   derivatives (equalities, size); those of rows need it first
//     differentiate        a row's at an instant, with room (size, 8)

template <typename Remaining> struct Predicted {
    typename Remaining::State state;
    double *coefficients;      // (6 + width, n)
    double *value, *violation; // (rows, K)
    double *worst;             // (blocks)
    double miss[Remaining::equalities], square;  // square: of all violations

    // The size of the miss, rad.
    double missed() const {
        if (Remaining::equalities == 1) return std::fabs(miss[0]);
        return std::sqrt(dot(miss, miss, Remaining::equalities));
    }
};

template <typename Remaining> class RestOfFlight {
  public:
    using At = Predicted<Remaining>;
    static constexpr Index equalities = Remaining::equalities;

    RestOfFlight(const typename Remaining::Body &robot, const Constraints &constraints, const CorrectedFlight &flight)
        : has_distances(constraints.needs_places), constraints(constraints), f(flight), n(robot.joints), K(f.instants),
          columns(6 + f.width), size(n * f.width), variables{size, K, f.basis, f.columns, 0, 0},
          remaining(robot, constraints, flight) {}

    const bool has_distances;
    double T = 0;

    Index links() const { return remaining.terms().links; }

    void lay_out(Arena &arena, At &a) const {
        remaining.lay_out(arena, a.state);
        arena.take(a.coefficients, columns * n);
        for (double **each : {&a.value, &a.violation}) arena.take(*each, constraints.rows * K);
        arena.take(a.worst, f.blocks);
    }

    void lay_out(Arena &arena) {
        remaining.lay_out(arena);
        arena.take(pack, 8 * size);
    }

    // From now to the landing, from the state that is estimated.
    void begin() {
        T = f.landing - f.now;
        remaining.begin(T);
    }

    // Distances are those of a base that turns to the goal, or not: the miss is taken off, by time.
    void land(bool at_goal) { remaining.landed = at_goal; }

    void evaluate(At &a) {
        Motion &m = Remaining::motion_of(a.state);
        m.per_second = 1 / T;
        combine(m, n, a.coefficients, columns, f.value, f.first, f.second);
        swing_joints(n, m, f.centre, f.amplitude);
        remaining.turn_base(a.state, a.miss);
        remaining.move_links(a.state, a.miss);
        evaluate_rows(a);
    }

    // Largest torque of each motor, N m.
    void find_torque_peaks(At &a) {
        remaining.find_moments(a.state);
        for (Index motor = 0; motor < f.motors; ++motor) {
            Vector most = all(0);
            for (Index k = 0; k < K; k += LANES) {
                const double *turns = f.turns + n + motor;
                const Motion &m = Remaining::motion_of(a.state);
                most = larger(magnitude(motor_torque(links(), m, turns, n + f.motors, k)), most);
            }
            f.torque_peak[motor] = largest(most);
        }
    }

    void differentiate_miss(At &a, double *rows) { remaining.differentiate_miss(a.state, variables, rows); }

    // Derivative (n width) of a row at an instant.
    void differentiate(At &a, Index row, Index k, double *slopes) {
        remaining.differentiate(a.state, variables, row, k, pack);
        for (Index c = 0; c < size; ++c) slopes[c] = pack[8 * c + k % 8];
    }

  private:
    const Constraints &constraints;
    const CorrectedFlight &f;
    const Index n, K, columns, size;
    const Variables variables;
    Remaining remaining;
    double *pack = nullptr;  // (size, 8)

    // Values of all rows, and by how much they are below their aims.
    void evaluate_rows(At &a) const {
        const Motion &m = Remaining::motion_of(a.state);
        a.square = 0;
        for (Index block = 0; block < f.blocks; ++block) {
            a.worst[block] = HUGE_VAL;
            for (Index r = f.block_first[block]; r < f.block_first[block + 1]; ++r) {
                double *value = a.value + r * K, *violation = a.violation + r * K;
                row_values<typename Remaining::Point>(remaining.terms(), constraints, m, r, 0, K, value);
                if (constraints.kind[r] > share_row) leave_out(m, r, value);
                const double least = find_violations(value, f.aim[block], f.softness[block], violation);
                if (least < a.worst[block] || std::isnan(least)) a.worst[block] = least;
                if (least >= f.aim[block]) continue;
                for (Index k = 0; k < K; ++k) a.square += violation[k] * violation[k];
            }
        }
    }

    // Values of distances are infinite outside of their windows and where links have no places.
    void leave_out(const Motion &m, Index row, double *value) const {
        const double begin = f.row_window[2 * row], end = f.row_window[2 * row + 1];
        for (Index k = 0; k < remaining.first_placed(); ++k) value[k] = HUGE_VAL;
        for (Index k = remaining.first_placed(); k < K; ++k)
            if (!(m.time[k] >= begin && m.time[k] <= end)) value[k] = HUGE_VAL;
    }

    // By how much values (K) are below an aim, 0 where they are not; returns the least of them, NaN where one is.
    double find_violations(const double *value, double aim, double softness, double *violation) const {
        Vector least = all(HUGE_VAL);
        for (Index k = 0; k < K; k += LANES) {
            const Vector own = load(value + k);
            store(violation + k, select(own >= all(aim), all(0), (all(aim) - own) / all(softness)));
            least = select((own < least) | (own != own), own, least);
        }
        double found = HUGE_VAL;
        for (Index lane = 0; lane < LANES; ++lane)
            if (least[lane] < found || std::isnan(least[lane])) found = least[lane];
        return found;
    }
};
