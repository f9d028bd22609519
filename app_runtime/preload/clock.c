// SPDX-License-Identifier: Apache-2.0
/* Virtual clocks for a program in lockstep, preloaded into it (LD_PRELOAD).
 *
 * The harness shares a page with the program (environment SIM2VR_CLOCK: its descriptor):
 *   int64 now_ns; uint32 generation; uint32 state (0 starting, 1 playing, 2 waiting at the gate)
 * It sets the time before each step; the runtime sets that of each frame by sim2vr_clock_advance.
 * CLOCK_MONOTONIC is then the frame's XrTime, and all other clocks of the wall keep their distance.
 *
 * Waits with a timeout, in virtual time:
 *   - at the gate only the harness moves time, so a timeout is over when a step has brought it;
 *   - the thread that takes frames sleeps no real time: its sleep moves virtual time on at once;
 *   - other threads wait for virtual time while frames come. Where none has come for a second of
 *     real time, and while the program starts, they wait real time and move virtual time on with
 *     it, so that nothing hangs.
 * A program that reads clocks in a loop for a second without a frame gets real time from then on.
 */
#define _GNU_SOURCE
#include "clock.h"

#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

typedef struct {
  _Atomic int64_t now_ns;
  _Atomic uint32_t generation;
  _Atomic uint32_t state;
} Page;

enum { STARTING = 0, WAITING = 2 };

static const int64_t kEpoch_ns = 1767225600LL * NS_PER_S; /* 2026-01-01 */
static const int64_t kStalled_ns = NS_PER_S;
static const uint32_t kReads = 20000;

static Page* _Atomic page; /* threads may have begun before this library did */
static _Atomic uint32_t seen_generation;
static _Atomic int64_t seen_real_ns;
static _Atomic uint32_t reads;
static _Atomic pthread_t frame_thread; /* 0: no frame was taken yet */

void* next_function(const char* name) {
  void* found = dlvsym(RTLD_NEXT, name, "GLIBC_2.3.2"); /* of pthread_cond_*, the newer one */
  return found != NULL ? found : dlsym(RTLD_NEXT, name);
}

typedef int (*ClockGettime)(clockid_t, struct timespec*);

static int real_gettime(clockid_t clock, struct timespec* out) {
  NEXT(ClockGettime, clock_gettime);
  return next_clock_gettime(clock, out);
}

int64_t real_ns(void) {
  struct timespec now;
  real_gettime(CLOCK_MONOTONIC, &now);
  return ns_of(&now);
}

__attribute__((constructor)) static void begin(void) {
  /* Lines of output are there when the frame is, also in a file. */
  setvbuf(stdout, NULL, _IOLBF, BUFSIZ);
  const char* given = getenv("SIM2VR_CLOCK");
  if (given == NULL) return;
  char* end = NULL;
  const long descriptor = strtol(given, &end, 10);
  if (end == given || *end != '\0') return;
  void* memory = mmap(NULL, sizeof(Page), PROT_READ | PROT_WRITE, MAP_SHARED, (int)descriptor, 0);
  if (memory == MAP_FAILED) return;
  seen_real_ns = real_ns();
  page = memory;
}

bool clock_is_virtual(void) { return page != NULL; }

int64_t virtual_ns(void) { return page->now_ns; }

void virtual_to(int64_t time_ns) {
  int64_t now = page->now_ns;
  while (now < time_ns && !atomic_compare_exchange_weak(&page->now_ns, &now, time_ns)) {
  }
}

PUBLIC void sim2vr_clock_advance(int64_t time_ns);
PUBLIC void sim2vr_clock_advance(int64_t time_ns) {
  if (page == NULL) return;
  frame_thread = pthread_self();
  virtual_to(time_ns);
  page->generation += 1;
}

bool is_frame_thread(void) { return pthread_equal(frame_thread, pthread_self()); }

/* Real time since the last frame or step; none while the harness has its turn. */
static int64_t since_progress_ns(void) {
  const int64_t now = real_ns();
  const uint32_t generation = page->generation;
  if (generation != seen_generation || page->state == WAITING) {
    seen_generation = generation;
    seen_real_ns = now;
    reads = 0;
    return 0;
  }
  return now - seen_real_ns;
}

/* Real time counts where a program starts, or where no frame comes any more. */
static bool real_time_counts(void) {
  if (page->state == WAITING) return false;
  return page->state == STARTING || since_progress_ns() > kStalled_ns;
}

Deadline deadline_in(int64_t length_ns) {
  const Deadline made = {virtual_ns() + length_ns, real_ns(), length_ns};
  return made;
}

Deadline deadline_at(const struct timespec* when) {
  int64_t at_ns = ns_of(when);
  if (at_ns > kEpoch_ns / 2) at_ns -= kEpoch_ns; /* of CLOCK_REALTIME */
  return deadline_in(at_ns - virtual_ns());
}

bool deadline_passed(const Deadline* deadline) {
  if (virtual_ns() >= deadline->virtual_ns) return true;
  if (!real_time_counts() || real_ns() - deadline->began_real_ns < deadline->length_ns)
    return false;
  virtual_to(deadline->virtual_ns);
  return true;
}

int64_t slice_ns(const Deadline* deadline, int64_t most_ns) {
  const int64_t left = deadline->virtual_ns - virtual_ns();
  return left < 0 ? 0 : left < most_ns ? left : most_ns;
}

/* Virtual time for a reader; moves on where someone reads in a loop and no frame comes. */
static int64_t read_ns(void) {
  if (++reads % 1024 == 0 && reads > kReads && since_progress_ns() > kStalled_ns) {
    static _Atomic int64_t last_real_ns;
    const int64_t now = real_ns(), before = atomic_exchange(&last_real_ns, now);
    const int64_t passed = now - before;
    virtual_to(virtual_ns() + (passed < NS_PER_S ? passed : NS_PER_MS));
  }
  return virtual_ns();
}

static bool of_the_wall(clockid_t clock) {
  return clock == CLOCK_MONOTONIC || clock == CLOCK_MONOTONIC_RAW ||
         clock == CLOCK_MONOTONIC_COARSE || clock == CLOCK_BOOTTIME || clock == CLOCK_REALTIME ||
         clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI;
}

static bool of_the_day(clockid_t clock) {
  return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI;
}

PUBLIC int clock_gettime(clockid_t clock, struct timespec* out) {
  if (page == NULL || !of_the_wall(clock)) return real_gettime(clock, out);
  *out = timespec_of(read_ns() + (of_the_day(clock) ? kEpoch_ns : 0));
  return 0;
}

PUBLIC int gettimeofday(struct timeval* restrict out, void* restrict zone) {
  typedef int (*Function)(struct timeval*, void*);
  NEXT(Function, gettimeofday);
  if (page == NULL) return next_gettimeofday(out, zone);
  const int64_t now = read_ns() + kEpoch_ns;
  out->tv_sec = now / NS_PER_S;
  out->tv_usec = now % NS_PER_S / 1000;
  return 0;
}

PUBLIC time_t time(time_t* out) {
  typedef time_t (*Function)(time_t*);
  NEXT(Function, time);
  if (page == NULL) return next_time(out);
  const time_t now = (read_ns() + kEpoch_ns) / NS_PER_S;
  if (out != NULL) *out = now;
  return now;
}

PUBLIC int timespec_get(struct timespec* out, int base) {
  typedef int (*Function)(struct timespec*, int);
  NEXT(Function, timespec_get);
  if (page == NULL || base != TIME_UTC) return next_timespec_get(out, base);
  *out = timespec_of(read_ns() + kEpoch_ns);
  return base;
}
