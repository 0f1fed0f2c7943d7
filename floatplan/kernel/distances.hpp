// Points, segments, and where they are nearest to one another, at the instants that are computed at once: in the plane, where
// a point is a Place, and in space, where it is Threes. What is not used of it, as directions where only the distance is, is
// not computed: all is compiled into its callers.

using Threes = Triple<Vector>;

struct Place {
    Vector x, y;
};

static inline Place operator+(Place a, Place b) { return {a.x + b.x, a.y + b.y}; }
static inline Place operator-(Place a, Place b) { return {a.x - b.x, a.y - b.y}; }
static inline Place operator-(Place a) { return {-a.x, -a.y}; }
static inline Place operator*(Vector s, Place a) { return {s * a.x, s * a.y}; }
static inline Vector inner(Place a, Place b) { return a.x * b.x + a.y * b.y; }
static inline Vector inner(Threes a, Threes b) { return dot(a, b); }
static inline Vector outer(Place a, Place b) { return a.x * b.y - a.y * b.x; }
static inline Place select(Bits mask, Place a, Place b) { return {select(mask, a.x, b.x), select(mask, a.y, b.y)}; }
static inline Threes select(Bits mask, Threes a, Threes b) {
    return {select(mask, a.x, b.x), select(mask, a.y, b.y), select(mask, a.z, b.z)};
}

// Coordinates of a point, and one at the same place at all instants.
template <typename P> constexpr Index dimensions = sizeof(P) / sizeof(Vector);
template <typename P> INLINED P everywhere(const double *point) {
    if constexpr (dimensions<P> == 2) return {all(point[0]), all(point[1])};
    else return triple<Vector>(point);
}

// A distance, the unit vector out of the other thing, and how far along each of the two the nearest points are.
template <typename P> struct Nearest {
    Vector distance;
    P direction;
    Vector own, other;
};

// The same before anything is divided by the distance: its square, the way out of the other thing, and the segment to which
// the direction is normal where there is no way.
template <typename P> struct Way {
    Vector square;
    P out, across;
    Vector own, other;
};

// A unit vector that is normal to a segment; any where that is a point.
INLINED Place normal_to(Place along) {
    const Vector length = square_root(inner(along, along));
    return select(length > all(0), 1 / length * Place{-along.y, along.x}, {all(0), all(1)});
}
INLINED Threes normal_to(Threes along) {
    const Bits steep = (magnitude(along.z) > magnitude(along.x)) & (magnitude(along.z) > magnitude(along.y));
    const Threes normal = select(steep, Threes{all(0), along.z, -along.y}, Threes{-along.y, along.x, all(0)});
    const Vector length = square_root(inner(normal, normal));
    return select(length > all(0), 1 / length * normal, Threes{all(0), all(0), all(1)});
}

template <typename P> INLINED Way<P> point_to_segment(P point, P start, P end) {
    const P along = end - start;
    const Vector squared = larger(inner(along, along), all(1e-300));
    const Vector fraction = smaller(larger(inner(along, point - start) / squared, all(0)), all(1));
    const P out = start + fraction * along - point;
    return {inner(out, out), out, along, fraction, all(0)};
}

// A way from the other side.
template <typename P> INLINED Way<P> turned_round(Way<P> way) {
    return {way.square, -way.out, -way.across, way.other, way.own};
}

template <typename P> INLINED Way<P> shorter(Way<P> a, Way<P> b) {
    const Bits nearer = b.square < a.square;
    return {select(nearer, b.square, a.square), select(nearer, b.out, a.out), select(nearer, b.across, a.across),
            select(nearer, b.own, a.own), select(nearer, b.other, a.other)};
}

template <typename P> INLINED Nearest<P> measured(Way<P> way) {
    const Vector distance = square_root(way.square);
    const P normal = normal_to(way.across);
    return {distance, select(distance >= all(1e-12), 1 / distance * way.out, normal), way.own, way.other};
}

// The shortest way between the ends of two segments and the other one.
template <typename P> INLINED Way<P> between_ends(P start, P end, P other_start, P other_end) {
    auto at_end = [](Way<P> way) { return Way<P>{way.square, way.out, way.across, way.own, all(1)}; };
    Way<P> way = turned_round(point_to_segment(start, other_start, other_end));
    way = shorter(way, turned_round(at_end(point_to_segment(end, other_start, other_end))));
    way = shorter(way, point_to_segment(other_start, start, end));
    return shorter(way, at_end(point_to_segment(other_end, start, end)));
}

INLINED Bits are_crossing(Place start, Place end, Place other_start, Place other_end) {
    const Vector in_line = all(1e-12), none = all(0);  // m^2
    const Place along = end - start, other_along = other_end - other_start;
    const Vector a = outer(along, other_start - start), b = outer(along, other_end - start);
    const Vector c = outer(other_along, start - other_start), d = outer(other_along, end - other_start);
    const Vector smallest = smaller(smaller(magnitude(a), magnitude(b)), smaller(magnitude(c), magnitude(d)));
    return (a * b < none) & (c * d < none) & (smallest > in_line);
}

// Between segments in the plane: where they cross, minus the shortest way out by one of their ends.
INLINED Nearest<Place> between(Place start, Place end, Place other_start, Place other_end) {
    Nearest<Place> found = measured(between_ends(start, end, other_start, other_end));
    const Bits crossing = are_crossing(start, end, other_start, other_end);
    found.distance = select(crossing, -found.distance, found.distance);
    found.direction = select(crossing, -found.direction, found.direction);
    return found;
}

// Between segments in space: at their ends, or between these where the lines that they are parts of are nearest there
// (Ericson, Real-Time Collision Detection, section 5.1.9). Lines that are nearly parallel are as near at an end.
INLINED Nearest<Threes> between(Threes start, Threes end, Threes other_start, Threes other_end) {
    const Vector parallel = all(1e-12), none = all(0), whole = all(1);  // [-] squared sine
    const Threes along = end - start, other_along = other_end - other_start, apart = start - other_start;
    const Vector a = inner(along, along), b = inner(along, other_along), e = inner(other_along, other_along);
    const Vector c = inner(along, apart), f = inner(other_along, apart), squared = a * e - b * b;
    const Bits meet = squared > parallel * a * e;
    const Vector per_squared = 1 / select(meet, squared, whole);
    const Vector own = (b * f - c * e) * per_squared, other = (a * f - b * c) * per_squared;
    const Bits inside = meet & (own > none) & (own < whole) & (other > none) & (other < whole);
    const Threes out = apart + own * along - other * other_along;
    const Way<Threes> inward{select(inside, inner(out, out), all(HUGE_VAL)), out, along, own, other};
    Nearest<Threes> found = measured(shorter(between_ends(start, end, other_start, other_end), inward));
    return found;
}

// From a segment to a box of half edges, by that of its faces from which the nearer end is farthest.
INLINED Nearest<Place> to_box(Place, Place, Place start, Place) { return {all(HUGE_VAL), start, all(0), all(0)}; }
INLINED Nearest<Threes> to_box(Threes middle, Threes half, Threes start, Threes end) {
    Nearest<Threes> found = {all(-HUGE_VAL), {all(0), all(0), all(0)}, all(0), all(0)};
    const auto face = [&](Vector first, Vector last, Vector edge, Threes normal) {
        const Vector nearer = smaller(first, last) - edge;
        const Bits is_farther = nearer > found.distance;
        found.distance = select(is_farther, nearer, found.distance);
        found.direction = select(is_farther, normal, found.direction);
        found.own = select(is_farther, select(last < first, all(1), all(0)), found.own);
    };
    const Threes first = start - middle, last = end - middle;
    const Vector none = all(0), one = all(1);
    face(first.x, last.x, half.x, {one, none, none});
    face(-first.x, -last.x, half.x, {-one, none, none});
    face(first.y, last.y, half.y, {none, one, none});
    face(-first.y, -last.y, half.y, {none, -one, none});
    face(first.z, last.z, half.z, {none, none, one});
    face(-first.z, -last.z, half.z, {none, none, -one});
    return found;
}

// From a segment to an obstacle at a time, s since takeoff, radii left out. Numbers of an obstacle are a point, another point
// or the normal of what is solid on one side or half the edges of a box, a velocity, and a radius.
template <typename P> constexpr Index obstacle_numbers = 3 * dimensions<P> + 1;

template <typename P> INLINED Nearest<P> to_obstacle(Index kind, const double *obstacle, Vector time, P start, P end) {
    constexpr Index D = dimensions<P>;
    const P moved = time * everywhere<P>(obstacle + 2 * D);
    const P one = everywhere<P>(obstacle) + moved, other = everywhere<P>(obstacle + D);
    if (kind == ball_row) return measured(point_to_segment(one, start, end));
    if (kind == bar_row) return between(start, end, one, other + moved);
    if (kind == box_row) return to_box(one, other, start, end);
    const Index at_end = kind == wall_end_row;
    return {inner(other, (at_end ? end : start) - one), other, all(at_end), all(0)};
}
