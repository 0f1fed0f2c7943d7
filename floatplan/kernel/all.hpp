// All that is compiled for each set of instructions: within a namespace that has the type Vector of LANES doubles,
// all() and multiply_add().
#include "lanes.hpp"
#include "planner.hpp"
#include "scaling.hpp"
#include "momentum.hpp"
#include "sqp.hpp"
#include "starts.hpp"
#include "batch.hpp"
#include "rest.hpp"
#include "law.hpp"
#include "flight.hpp"
#include "peaks.hpp"
#include "watch.hpp"
