// Points, segments, and where they are nearest to one another, at the instants that are computed at once. What is not
// used of it, as directions where only the distance is, is not computed: all is compiled into its callers.

struct Place {
    Vector x, y;
};

static inline Place operator+(Place a, Place b) { return {a.x + b.x, a.y + b.y}; }
static inline Place operator-(Place a, Place b) { return {a.x - b.x, a.y - b.y}; }
static inline Place operator-(Place a) { return {-a.x, -a.y}; }
static inline Place operator*(Vector s, Place a) { return {s * a.x, s * a.y}; }
static inline Vector inner(Place a, Place b) { return a.x * b.x + a.y * b.y; }
static inline Vector outer(Place a, Place b) { return a.x * b.y - a.y * b.x; }
static inline Place select(Bits mask, Place a, Place b) { return {select(mask, a.x, b.x), select(mask, a.y, b.y)}; }

// A distance, the unit vector out of the other thing, and how far along each of the two the nearest points are.
struct Nearest {
    Vector distance;
    Place direction;
    Vector own, other;
};

// The same before anything is divided by the distance: its square, the way out of the other thing, and the segment whose
// normal is the direction where there is no way.
struct Way {
    Vector square;
    Place out, across;
    Vector own, other;
};

INLINED Way point_to_segment(Place point, Place start, Place end) {
    const Place along = end - start;
    const Vector squared = larger(inner(along, along), all(1e-300));
    const Vector share = smaller(larger(inner(along, point - start) / squared, all(0)), all(1));
    const Place out = start + share * along - point;
    return {inner(out, out), out, along, share, all(0)};
}

// A way from the other side.
INLINED Way turned_round(Way way) { return {way.square, -way.out, -way.across, way.other, way.own}; }

INLINED Way shorter(Way a, Way b) {
    const Bits nearer = b.square < a.square;
    return {select(nearer, b.square, a.square), select(nearer, b.out, a.out), select(nearer, b.across, a.across),
            select(nearer, b.own, a.own), select(nearer, b.other, a.other)};
}

INLINED Nearest measured(Way way) {
    const Vector distance = square_root(way.square), length = square_root(inner(way.across, way.across));
    const Place normal = select(length > all(0), 1 / length * Place{-way.across.y, way.across.x}, {all(0), all(1)});
    return {distance, select(distance >= all(1e-12), 1 / distance * way.out, normal), way.own, way.other};
}

INLINED Bits are_crossing(Place start, Place end, Place other_start, Place other_end) {
    const Vector in_line = all(1e-12), none = all(0);  // m^2
    const Place along = end - start, other_along = other_end - other_start;
    const Vector a = outer(along, other_start - start), b = outer(along, other_end - start);
    const Vector c = outer(other_along, start - other_start), d = outer(other_along, end - other_start);
    const Vector least = smaller(smaller(magnitude(a), magnitude(b)), smaller(magnitude(c), magnitude(d)));
    return (a * b < none) & (c * d < none) & (least > in_line);
}

INLINED Nearest between(Place start, Place end, Place other_start, Place other_end) {
    auto at_end = [](Way way) { return Way{way.square, way.out, way.across, way.own, all(1)}; };
    Way way = turned_round(point_to_segment(start, other_start, other_end));
    way = shorter(way, turned_round(at_end(point_to_segment(end, other_start, other_end))));
    way = shorter(way, point_to_segment(other_start, start, end));
    way = shorter(way, at_end(point_to_segment(other_end, start, end)));
    Nearest found = measured(way);
    const Bits crossing = are_crossing(start, end, other_start, other_end);
    found.distance = select(crossing, -found.distance, found.distance);
    found.direction = select(crossing, -found.direction, found.direction);
    return found;
}

// From a segment to an obstacle at a time, s since takeoff, radii left out; the half-plane's normal is the other place.
INLINED Nearest to_obstacle(Index kind, const double *obstacle, Vector time, Place start, Place end) {
    const Place moved = time * Place{all(obstacle[4]), all(obstacle[5])};
    const Place one = Place{all(obstacle[0]), all(obstacle[1])} + moved, other{all(obstacle[2]), all(obstacle[3])};
    if (kind == circle_row) return measured(point_to_segment(one, start, end));
    if (kind == bar_row) return between(start, end, one, other + moved);
    const Index at_end = kind == half_plane_end_row;
    return {inner(other, (at_end ? end : start) - one), other, all(at_end), all(0)};
}
