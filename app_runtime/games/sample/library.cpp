// Makes a shared library of a game outside the repository: the only file that names its classes.
#include "sample.hpp"
#include "sim2vr/games/library.hpp"

SIM2VR_GAMES(sim2vr::games::sample::TouchTheBall)
