// SPDX-License-Identifier: Apache-2.0
/* Sleeps and waits with a timeout, in virtual time; see clock.c for what that means. */
#define _GNU_SOURCE
#include <errno.h>
#include <linux/futex.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/select.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"

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
