// Points, segments, and where they are nearest to one another.

struct Place {
    double x, y;
};

static inline Place operator+(Place a, Place b) { return {a.x + b.x, a.y + b.y}; }
static inline Place operator-(Place a, Place b) { return {a.x - b.x, a.y - b.y}; }
static inline Place operator*(double s, Place a) { return {s * a.x, s * a.y}; }
static inline double inner(Place a, Place b) { return a.x * b.x + a.y * b.y; }
static inline double outer(Place a, Place b) { return a.x * b.y - a.y * b.x; }

// A distance, the unit vector out of the other thing, and how far along each of the two the nearest points are.
struct Nearest {
    double distance;
    Place direction;
    double own, other;
};

static inline Nearest point_to_segment(Place point, Place start, Place end) {
    Place along = end - start;
    double squared = larger(inner(along, along), 1e-300);
    double share = smaller(larger(inner(along, point - start) / squared, 0), 1);
    Place offset = start + share * along - point;
    double distance = std::sqrt(inner(offset, offset));
    if (distance >= 1e-12) return {distance, 1 / distance * offset, share, 0};
    double length = std::sqrt(squared);
    Place sideways{-along.y / length, along.x / length};
    return {distance, inner(sideways, sideways) > 0.25 ? sideways : Place{0, 1}, share, 0};
}

static inline bool are_crossing(Place start, Place end, Place other_start, Place other_end) {
    constexpr double in_line = 1e-12;  // m^2
    double a = outer(end - start, other_start - start), b = outer(end - start, other_end - start);
    Place along = other_end - other_start;
    double c = outer(along, start - other_start), d = outer(along, end - other_start);
    double least = smaller(smaller(std::fabs(a), std::fabs(b)), smaller(std::fabs(c), std::fabs(d)));
    return a * b < 0 && c * d < 0 && least > in_line;
}

static inline Nearest between(Place start, Place end, Place other_start, Place other_end) {
    Nearest best = point_to_segment(start, other_start, other_end);
    best = {best.distance, -1 * best.direction, 0, best.own};
    Nearest next = point_to_segment(end, other_start, other_end);
    if (next.distance < best.distance) best = {next.distance, -1 * next.direction, 1, next.own};
    next = point_to_segment(other_start, start, end);
    if (next.distance < best.distance) best = {next.distance, next.direction, next.own, 0};
    next = point_to_segment(other_end, start, end);
    if (next.distance < best.distance) best = {next.distance, next.direction, next.own, 1};
    if (are_crossing(start, end, other_start, other_end)) {
        best.distance = -best.distance;
        best.direction = -1 * best.direction;
    }
    return best;
}

// From a segment to an obstacle at a time, s since takeoff, radii left out; the half-plane's normal is the other place.
static inline Nearest to_obstacle(Index kind, const double *obstacle, double time, Place start, Place end) {
    Place moved = time * Place{obstacle[4], obstacle[5]}, one = Place{obstacle[0], obstacle[1]} + moved;
    Place other{obstacle[2], obstacle[3]};
    if (kind == circle_row) return point_to_segment(one, start, end);
    if (kind == bar_row) return between(start, end, one, other + moved);
    double share = kind == half_plane_end_row;
    return {inner(other, (share == 1 ? end : start) - one), other, share, 0};
}
