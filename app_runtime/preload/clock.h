// SPDX-License-Identifier: Apache-2.0
/* Virtual time of a program that the harness plays; see clock.c. */
#ifndef SIM2VR_CLOCK_H
#define SIM2VR_CLOCK_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <time.h>

#define PUBLIC __attribute__((visibility("default")))

enum { NS_PER_S = 1000000000, NS_PER_MS = 1000000 };

/* Nanoseconds that a wait is over at, of virtual time; of real time where virtual time is off. */
typedef struct {
  int64_t virtual_ns;
  int64_t began_real_ns;
  int64_t length_ns;
} Deadline;

/* Next function of this name after ours. */
void* next_function(const char* name);
/* Declares next_NAME, which is looked up once. Threads that meet here find the same address. */
#define NEXT(type, name)              \
  static _Atomic(type) known_##name;  \
  type next_##name = known_##name;    \
  if (next_##name == NULL) known_##name = next_##name = (type)next_function(#name)
/* Real monotonic time. */
int64_t real_ns(void);
/* Whether time is virtual in this process. */
bool clock_is_virtual(void);
/* Virtual monotonic time. */
int64_t virtual_ns(void);
/* Move virtual time on; it never goes back. */
void virtual_to(int64_t time_ns);
/* Whether this thread takes the frames, so that its sleeps are over at once. */
bool is_frame_thread(void);

Deadline deadline_in(int64_t length_ns);
/* Of an absolute time of any clock of ours. */
Deadline deadline_at(const struct timespec* when);
bool deadline_passed(const Deadline* deadline);
/* Real nanoseconds to wait before the deadline is looked at again. */
int64_t slice_ns(const Deadline* deadline, int64_t most_ns);

static inline int64_t ns_of(const struct timespec* t) {
  return (int64_t)t->tv_sec * NS_PER_S + t->tv_nsec;
}
static inline struct timespec timespec_of(int64_t ns) {
  const struct timespec t = {.tv_sec = ns / NS_PER_S, .tv_nsec = ns % NS_PER_S};
  return t;
}

#endif
