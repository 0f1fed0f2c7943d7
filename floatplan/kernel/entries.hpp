// What dispatch.cpp calls of each set of instructions; within its namespace.
Index measure_batch(const Robot &robot, const Interpolation *interpolations, const Constraints *constraints, Peaks &peaks);
Index flight_room(const Robot &robot, const Constraints &constraints, CorrectedFlight &flight);
void update_flight(const Robot &robot, const Constraints &constraints, CorrectedFlight &flight, Index what);
Index flight_room_in_space(const SpatialBody &robot, const Constraints &constraints, CorrectedFlight &flight);
void update_flight_in_space(const SpatialBody &robot, const Constraints &constraints, CorrectedFlight &flight, Index what);
Index solve_quadratic(Quadratic &qp);
Index follow_rows(const Robot &robot, const Constraints *constraints, const Motions *motions, const Nodes *levels,
                  const Settings &settings, const Exchange &exchange, const Powers *powers,
                  SearchProblem *problems, SamplingOptions *sampling, Index count);
Index evaluate_program(const Robot &robot, const Constraints &constraints, const Motions &motions, const Nodes *levels,
                       const Settings &settings, const Exchange &exchange, SearchProblem &problem, Evaluation &at);
Index follow_in_space(const SpatialBody *bodies, const Cells *cells, const Constraints *constraints, const Motions *motions,
                      const Nodes *levels, const Settings &settings, const Exchange &exchange, const Powers *powers,
                      SearchProblem *problems, SamplingOptions *sampling, Index count);
Index evaluate_in_space(const SpatialBody &body, const Cells *cells, const Constraints &constraints, const Motions &motions,
                        const Nodes *levels, const Settings &settings, const Exchange &exchange, SearchProblem &problem,
                        Evaluation &at);
Index lift_motion(const SpatialBody &body, const Cells &cells, const Motions &motions, const Nodes &nodes, Lifted &of);
Index move_in_space(const SpatialTree &tree, const SpatialMotion &motion);
Index place_bodies(const SpatialTree &tree, const SpatialPoses &poses);
Index lowest_points(const PlacedSolids &solids);
Index reach_on_ground(const PlacedSolids &solids);
Index bend_limb(const SpatialTree &tree, const LimbTargets &targets);
Index turn_in_space(const Turning &turning, Asked asked);
Index bound_boxes(const Cosines &cosines);
