// A class of motions that lands on other branches of the arcsine than another: odd ones mirror p about pi/2.

class BranchedMotions {
  public:
    Motions at;

    BranchedMotions(const Motions &plain, const double *offset_map, Index joints)
        : at(plain), plain(plain), offset_map(offset_map), n(joints), free(plain.first[joints]) {}

    void lay_out(Arena &arena) {
        arena.take(boundary, n * plain.fixed_columns);
        arena.take(offset, free);
        arena.take(rates, plain.goal.knots * n);
        for (double **each : {&curvature, &bend}) arena.take(*each, n);
        at.boundary = boundary;
        at.offset = offset;
        if (plain.goal.knots) at.goal = {plain.goal.knots, plain.goal.momenta, rates, curvature, bend};
    }

    void land_on(const Index *branch) {
        copy(boundary, plain.boundary, n * plain.fixed_columns);
        copy(offset, plain.offset, free);
        for (Index i = 0; i < n; ++i) {
            const double sign = branch[i] % 2 ? -1 : 1;
            double *own = boundary + i * plain.fixed_columns;
            for (Index condition = 3; condition < 6; ++condition)
                if (plain.condition[condition] >= 0) own[plain.condition[condition]] *= sign;
            own[plain.condition[3]] += branch[i] * 3.141592653589793;
            for (Index knot = 0; knot < plain.goal.knots; ++knot)
                rates[knot * n + i] = sign * plain.goal.rates[knot * n + i];
            if (plain.goal.knots) {
                curvature[i] = sign * plain.goal.curvature[i];
                bend[i] = sign * plain.goal.bend[i];
            }
            for (Index r = plain.first[i]; offset_map && branch[i] && r < plain.first[i + 1]; ++r)
                offset[r] = dot(offset_map + r * plain.fixed_columns, own, plain.fixed_columns);
        }
    }

  private:
    const Motions &plain;
    const double *offset_map;
    Index n, free;
    double *boundary, *offset, *rates, *curvature, *bend;
};
