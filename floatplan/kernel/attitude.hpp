// The attitude of the base in flight: R_WB(s) between the nodes of the collocation that has integrated it (turning.hpp), and
// which turns it makes on its way.
//
// In a cell that begins with the attitude R_0, R_WB = R_0 exp(carried) exp(still), where the quaternions of both rotations
// are integrals of polynomials through their rates at the stages: what the momentum carries round, and what the joints turn
// while it is still. Without momentum there is no first one.

// The angles about the goal's axes on the way there: whether it makes the turns that are wanted, without tilting too far.
class TurnsMade {
  public:
    explicit TurnsMade(const SpatialBody &spatial_body) : spatial_body(spatial_body) {}

    // The next attitude (3, 3), less than half a turn from the one before.
    void take(const double *attitude) {
        if (!spatial_body.angles) return;
        Vector3 now = angles_about(spatial_body.angles, matrix3(attitude));
        steepest = larger(steepest, std::fabs(spatial_body.angles[0] == spatial_body.angles[2] ? now.y - full_turn / 4 : now.y));
        if (!has_begun) first = last = now;
        has_begun = true;
        now.x -= full_turn * std::round((now.x - last.x) / full_turn);
        now.z -= full_turn * std::round((now.z - last.z) / full_turn);
        last = now;
    }

    bool is_right() const {
        if (!spatial_body.angles) return true;
        const Vector3 change = last - first - vector3(spatial_body.change);
        const double most = larger(larger(std::fabs(change.x), std::fabs(change.y)), std::fabs(change.z));
        return most < spatial_body.wrong_turn && steepest <= spatial_body.most_tilt;
    }

  private:
    static constexpr double full_turn = 6.283185307179586;  // rad
    const SpatialBody &spatial_body;
    bool has_begun = false;
    double steepest = 0;
    Vector3 first{}, last{};
};

// How the base turns in the cells of a level.
struct Turned {
    Turning cells;
    double *inertia, *relative;  // (K, 3, 3), (K, 3)
    bool is_known;

    void lay_out(Arena &arena, Index most_nodes) {
        for (double **each : {&inertia, &cells.inverse, &cells.attitudes, &cells.turn_weights})
            arena.take(*each, 9 * most_nodes);
        for (double **each : {&relative, &cells.rates}) arena.take(*each, 3 * most_nodes);
        for (double **each : {&cells.still_rates, &cells.carried_rates}) arena.take(*each, 4 * most_nodes);
        for (double **each : {&cells.borders, &cells.ends, &cells.transitions}) arena.take(*each, 9 * most_nodes);
    }

    const double *landing() const { return cells.ends + 9 * (cells.cells - 1); }

    // R_WB at s in [0, 1], by the collocation's own polynomials.
    Matrix3 at(const Cells &rule, double s) const {
        const Index cell = std::min(static_cast<Index>(s * cells.cells), cells.cells - 1), S = cells.stages;
        double reached[MOST_STAGES];
        chebyshev_sums(rule.antiderivative, S + 1, S, s * cells.cells - cell, 1, reached);
        const double step = cells.duration / cells.cells;
        Matrix3 attitude = matrix3(cells.borders + 9 * cell);
        for (const double *rates : {cells.carried_rates, cells.still_rates}) {
            if (rates == cells.carried_rates && !is_pulled()) continue;
            double quaternion[] = {0, 0, 0, 1};
            for (Index k = 0; k < S; ++k) add(step * reached[k], rates + 4 * (cell * S + k), 4, quaternion);
            attitude = attitude * rotation(quaternion);
        }
        return attitude;
    }

    bool is_pulled() const {
        const Vector3 h = vector3(cells.momentum);
        return dot(h, h) > 0;
    }

    static constexpr Index MOST_STAGES = 16;
};
