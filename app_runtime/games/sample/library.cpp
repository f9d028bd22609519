// SPDX-License-Identifier: Apache-2.0
// Makes a shared library of a game outside the repository: the only file that names its classes.
#include "sim2vr/games/library.hpp"
#include "sample.hpp"

SIM2VR_GAMES(sim2vr::games::sample::TouchTheBall)
