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
#include <dlfcn.h>
#include <errno.h>
#include <linux/futex.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

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

/* How long the kernel waits before virtual time is looked at again. */
static const int64_t kSlice_ns = NS_PER_MS;
/* Of a wait that ends as a spurious one then, which the caller looks through. */
static const int64_t kSpurious_ns = 5 * NS_PER_MS;

static int64_t min_ns(int64_t a, int64_t b) { return a < b ? a : b; }

/* --- sleeps ----------------------------------------------------------------------------------- */

typedef int (*ClockNanosleep)(clockid_t, int, const struct timespec*, struct timespec*);

static int real_sleep(int64_t ns) {
  NEXT(ClockNanosleep, clock_nanosleep);
  const struct timespec length = timespec_of(ns);
  return next_clock_nanosleep(CLOCK_MONOTONIC, 0, &length, NULL);
}

/* Sleep until a deadline; the error number of what interrupts it. */
static int sleep_until(const Deadline* deadline) {
  if (is_frame_thread()) {
    virtual_to(deadline->virtual_ns);
    sched_yield();
    return 0;
  }
  while (!deadline_passed(deadline)) {
    const int error = real_sleep(min_ns(kSlice_ns, deadline->length_ns));
    if (error != 0) return error;
  }
  return 0;
}

static bool is_length(const struct timespec* t) {
  return t != NULL && t->tv_sec >= 0 && t->tv_nsec >= 0 && t->tv_nsec < NS_PER_S;
}

PUBLIC int clock_nanosleep(clockid_t clock, int flags, const struct timespec* wanted,
                           struct timespec* left) {
  NEXT(ClockNanosleep, clock_nanosleep);
  const bool cpu = clock != CLOCK_MONOTONIC && clock != CLOCK_REALTIME &&
                   clock != CLOCK_BOOTTIME && clock != CLOCK_TAI;
  if (!clock_is_virtual() || cpu || !is_length(wanted))
    return next_clock_nanosleep(clock, flags, wanted, left);
  const Deadline deadline =
      (flags & TIMER_ABSTIME) != 0 ? deadline_at(wanted) : deadline_in(ns_of(wanted));
  const int error = sleep_until(&deadline);
  if (error == EINTR && left != NULL && (flags & TIMER_ABSTIME) == 0)
    *left = timespec_of(slice_ns(&deadline, INT64_MAX));
  return error;
}

PUBLIC int nanosleep(const struct timespec* wanted, struct timespec* left) {
  typedef int (*Function)(const struct timespec*, struct timespec*);
  NEXT(Function, nanosleep);
  if (!clock_is_virtual() || !is_length(wanted)) return next_nanosleep(wanted, left);
  const int error = clock_nanosleep(CLOCK_MONOTONIC, 0, wanted, left);
  if (error == 0) return 0;
  errno = error;
  return -1;
}

PUBLIC int usleep(useconds_t us) {
  const struct timespec wanted = timespec_of((int64_t)us * 1000);
  return nanosleep(&wanted, NULL);
}

PUBLIC unsigned int sleep(unsigned int seconds) {
  const struct timespec wanted = {.tv_sec = seconds};
  struct timespec left;
  return nanosleep(&wanted, &left) == 0 ? 0 : (unsigned int)left.tv_sec + 1;
}

/* --- descriptors ------------------------------------------------------------------------------ */

typedef int (*Ppoll)(struct pollfd*, nfds_t, const struct timespec*, const sigset_t*);

/* A wait of any kind for descriptors, in slices; `wait` returns 0 after one without an event. */
#define IN_SLICES(deadline, wait)                                        \
  for (;;) {                                                             \
    const bool over = deadline_passed(&(deadline));                      \
    const struct timespec slice =                                        \
        timespec_of(over ? 0 : slice_ns(&(deadline), kSlice_ns));        \
    const int found = (wait);                                            \
    if (found != 0 || over) return found;                                \
  }

PUBLIC int ppoll(struct pollfd* fds, nfds_t count, const struct timespec* timeout,
                 const sigset_t* mask) {
  NEXT(Ppoll, ppoll);
  if (!clock_is_virtual() || !is_length(timeout) || ns_of(timeout) == 0)
    return next_ppoll(fds, count, timeout, mask);
  const Deadline deadline = deadline_in(ns_of(timeout));
  IN_SLICES(deadline, next_ppoll(fds, count, &slice, mask))
}

PUBLIC int poll(struct pollfd* fds, nfds_t count, int timeout_ms) {
  typedef int (*Function)(struct pollfd*, nfds_t, int);
  NEXT(Function, poll);
  if (!clock_is_virtual() || timeout_ms <= 0) return next_poll(fds, count, timeout_ms);
  const struct timespec timeout = timespec_of((int64_t)timeout_ms * NS_PER_MS);
  return ppoll(fds, count, &timeout, NULL);
}

PUBLIC int pselect(int count, fd_set* restrict in, fd_set* restrict out, fd_set* restrict failed,
                   const struct timespec* restrict timeout, const sigset_t* restrict mask) {
  typedef int (*Function)(int, fd_set*, fd_set*, fd_set*, const struct timespec*, const sigset_t*);
  NEXT(Function, pselect);
  if (!clock_is_virtual() || !is_length(timeout) || ns_of(timeout) == 0)
    return next_pselect(count, in, out, failed, timeout, mask);
  fd_set* sets[3] = {in, out, failed};
  fd_set wanted[3];
  for (int k = 0; k < 3; ++k)
    if (sets[k] != NULL) wanted[k] = *sets[k];
  const Deadline deadline = deadline_in(ns_of(timeout));
  for (;;) {
    const bool over = deadline_passed(&deadline);
    const struct timespec slice = timespec_of(over ? 0 : slice_ns(&deadline, kSlice_ns));
    const int found = next_pselect(count, in, out, failed, &slice, mask);
    if (found != 0 || over) return found;
    for (int k = 0; k < 3; ++k)
      if (sets[k] != NULL) *sets[k] = wanted[k];
  }
}

PUBLIC int select(int count, fd_set* restrict in, fd_set* restrict out, fd_set* restrict failed,
                  struct timeval* restrict timeout) {
  typedef int (*Function)(int, fd_set*, fd_set*, fd_set*, struct timeval*);
  NEXT(Function, select);
  if (!clock_is_virtual() || timeout == NULL || (timeout->tv_sec == 0 && timeout->tv_usec == 0))
    return next_select(count, in, out, failed, timeout);
  const struct timespec length =
      timespec_of((int64_t)timeout->tv_sec * NS_PER_S + (int64_t)timeout->tv_usec * 1000);
  return pselect(count, in, out, failed, &length, NULL);
}

PUBLIC int epoll_pwait(int epoll, struct epoll_event* events, int most, int timeout_ms,
                       const sigset_t* mask) {
  typedef int (*Function)(int, struct epoll_event*, int, int, const sigset_t*);
  NEXT(Function, epoll_pwait);
  if (!clock_is_virtual() || timeout_ms <= 0)
    return next_epoll_pwait(epoll, events, most, timeout_ms, mask);
  const Deadline deadline = deadline_in((int64_t)timeout_ms * NS_PER_MS);
  for (;;) {
    const bool over = deadline_passed(&deadline);
    const int found = next_epoll_pwait(epoll, events, most, over ? 0 : 1, mask);
    if (found != 0 || over) return found;
  }
}

PUBLIC int epoll_wait(int epoll, struct epoll_event* events, int most, int timeout_ms) {
  return epoll_pwait(epoll, events, most, timeout_ms, NULL);
}

/* --- conditions and semaphores ---------------------------------------------------------------- */

typedef int (*CondClockwait)(pthread_cond_t*, pthread_mutex_t*, clockid_t, const struct timespec*);

/* Returns 0 after a while without an event, as a spurious wake: a signal between two waits of ours
 * would be lost, but the caller looks at its condition. */
static int cond_wait(pthread_cond_t* cond, pthread_mutex_t* mutex, const struct timespec* when) {
  NEXT(CondClockwait, pthread_cond_clockwait);
  const Deadline deadline = deadline_at(when);
  if (deadline_passed(&deadline)) return ETIMEDOUT;
  const struct timespec slice =
      timespec_of(real_ns() + min_ns(kSpurious_ns, deadline.length_ns));
  const int found = next_pthread_cond_clockwait(cond, mutex, CLOCK_MONOTONIC, &slice);
  if (found != ETIMEDOUT) return found;
  return deadline_passed(&deadline) ? ETIMEDOUT : 0;
}

PUBLIC int pthread_cond_clockwait(pthread_cond_t* cond, pthread_mutex_t* mutex, clockid_t clock,
                                  const struct timespec* when) {
  NEXT(CondClockwait, pthread_cond_clockwait);
  if (!clock_is_virtual()) return next_pthread_cond_clockwait(cond, mutex, clock, when);
  return cond_wait(cond, mutex, when);
}

PUBLIC int pthread_cond_timedwait(pthread_cond_t* restrict cond, pthread_mutex_t* restrict mutex,
                                  const struct timespec* restrict when) {
  typedef int (*Function)(pthread_cond_t*, pthread_mutex_t*, const struct timespec*);
  NEXT(Function, pthread_cond_timedwait);
  if (!clock_is_virtual()) return next_pthread_cond_timedwait(cond, mutex, when);
  return cond_wait(cond, mutex, when);
}

typedef int (*SemClockwait)(sem_t*, clockid_t, const struct timespec*);

static int semaphore_wait(sem_t* semaphore, const struct timespec* when) {
  NEXT(SemClockwait, sem_clockwait);
  const Deadline deadline = deadline_at(when);
  for (;;) {
    const bool over = deadline_passed(&deadline);
    const struct timespec slice =
        timespec_of(real_ns() + (over ? 0 : min_ns(kSlice_ns, deadline.length_ns)));
    if (next_sem_clockwait(semaphore, CLOCK_MONOTONIC, &slice) == 0) return 0;
    if (errno != ETIMEDOUT || over) return -1;
  }
}

PUBLIC int sem_clockwait(sem_t* semaphore, clockid_t clock, const struct timespec* when) {
  NEXT(SemClockwait, sem_clockwait);
  if (!clock_is_virtual()) return next_sem_clockwait(semaphore, clock, when);
  return semaphore_wait(semaphore, when);
}

PUBLIC int sem_timedwait(sem_t* restrict semaphore, const struct timespec* restrict when) {
  typedef int (*Function)(sem_t*, const struct timespec*);
  NEXT(Function, sem_timedwait);
  if (!clock_is_virtual()) return next_sem_timedwait(semaphore, when);
  return semaphore_wait(semaphore, when);
}

/* --- futexes, as Qt and Rust use them --------------------------------------------------------- */

typedef long (*Syscall)(long, ...);

static long futex_wait(Syscall next, const long* a) {
  const struct timespec* when = (const struct timespec*)a[3];
  const bool absolute = (a[1] & FUTEX_CMD_MASK) == FUTEX_WAIT_BITSET;
  const Deadline deadline = absolute ? deadline_at(when) : deadline_in(ns_of(when));
  const long operation = a[1] & ~(long)FUTEX_CLOCK_REALTIME;
  for (;;) {
    const bool over = deadline_passed(&deadline);
    const int64_t length = over ? 0 : slice_ns(&deadline, kSlice_ns);
    const struct timespec slice = timespec_of(absolute ? real_ns() + length : length);
    const long found = next(SYS_futex, a[0], operation, a[2], &slice, a[4], a[5]);
    if (found == 0 || errno != ETIMEDOUT || over) return found;
  }
}

PUBLIC long syscall(long number, ...) {
  NEXT(Syscall, syscall);
  va_list given;
  va_start(given, number);
  long a[6];
  for (int k = 0; k < 6; ++k) a[k] = va_arg(given, long);
  va_end(given);
  if (number == SYS_futex && clock_is_virtual() && a[3] != 0) {
    const long command = a[1] & FUTEX_CMD_MASK;
    if (command == FUTEX_WAIT || command == FUTEX_WAIT_BITSET) return futex_wait(next_syscall, a);
  }
  return next_syscall(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
