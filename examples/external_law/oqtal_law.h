/* An attitude law of one's own for oqtal, in one file: the packets, and three functions. C99 and POSIX, little-endian.
 *
 * Questions and answers are described in docs/your-own-law.md. All numbers are in SI units and radians; world axes have z up, body axes
 * x forward, y left, z up; quaternions have their scalar last and turn body into world axes. */
#ifndef OQTAL_LAW_H
#define OQTAL_LAW_H

#include <errno.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* State and reference for the instant at which the command takes effect. */
struct oqtal_state {
    char magic[8];                /* "OQTALST1" */
    uint64_t sequence;            /* number of this question */
    uint64_t flight;              /* number of the flight: restart integrals when it changes */
    uint64_t flown;               /* 1 if the last answer was flown */
    uint64_t time;                /* tick, ns, CLOCK_BOOTTIME */
    uint64_t acts_at;             /* effect of the command, ns */
    uint64_t answer_by;           /* deadline, ns; 0 in virtual time */
    double period_s;              /* s */
    double position[3];           /* m, world */
    double velocity[3];           /* m/s, world */
    double attitude[4];           /* x y z w, body to world */
    double rate[3];               /* rad/s, body */
    double thrust;                /* N */
    double acceleration_bias[3];  /* m/s^2, world: wind and whatever the model lacks */
    double demand_bias[3];        /* rad/s, body (rad/s^2 for a torque): subtract it from the commanded rates */
    double reference_position[3]; /* m, world */
    double reference_velocity[3]; /* m/s, world */
    double reference_yaw;         /* rad */
    double reference_attitude[4]; /* NaN unless an attitude is prescribed */
    double reference_rate[3];     /* rad/s, body; NaN unless an attitude is prescribed */
    double fallback_rate[3];      /* rad/s, body: the command of the fallback law, as are the next three */
    double fallback_torque[3];    /* N m, body */
    double fallback_attitude[4];  /* x y z w, body to world */
    double fallback_thrust;       /* N */
    double mass;                  /* kg */
    double gravity;               /* m/s^2 */
    double greatest_thrust;       /* N */
    double greatest_rate[3];      /* rad/s, body */
    double greatest_torque;       /* N m, body */
    double reference_acceleration[3]; /* m/s^2, world: also of a goto or a stop; zero where a planner sends none */
    double reference_jerk[3];     /* m/s^3, world: zero in a goto and where a planner sends none */
};

/* The answer. Only the numbers for the vehicle's interface are used. */
struct oqtal_answer {
    char magic[8];      /* "OQTALEX1" */
    uint64_t sequence;  /* that of the question */
    double rate[3];     /* rad/s, body: vehicle.interface = "rate"; sent with an attitude */
    double torque[3];   /* N m, body: vehicle.interface = "torque" */
    double attitude[4]; /* x y z w, body to world: vehicle.interface = "attitude" */
    double thrust;      /* N, along body z */
};

/* Connects to the daemon; `path` is the file `law` in the directory of the instance. Returns a descriptor, -1 on failure. */
static inline int oqtal_connect(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path)
        return -1;
    strcpy(address.sun_path, path);
    int law = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    if (law >= 0 && connect(law, (struct sockaddr *)&address, sizeof address) == 0)
        return law;
    close(law);
    return -1;
}

/* Waits for the next question. Returns 1; 0 once the daemon has ended; 0 with errno EPROTO for a question of another version. */
static inline int oqtal_receive(int law, struct oqtal_state *state)
{
    for (;;) {
        errno = 0;
        /* MSG_TRUNC: the length of the packet, also of one that is longer than a question. */
        ssize_t length = recv(law, state, sizeof *state, MSG_TRUNC);
        if (length < 0 && errno == EINTR)
            continue;
        if (length <= 0)
            return 0;
        if (length == sizeof *state && memcmp(state->magic, "OQTALST1", 8) == 0)
            return 1;
        errno = EPROTO;
        return 0;
    }
}

/* Sends the answer to `state`; magic and sequence are filled in. Returns 1, or 0 once the daemon has ended. */
static inline int oqtal_answer(int law, const struct oqtal_state *state, struct oqtal_answer *answer)
{
    memcpy(answer->magic, "OQTALEX1", 8);
    answer->sequence = state->sequence;
    ssize_t length;
    do
        length = send(law, answer, sizeof *answer, MSG_NOSIGNAL);
    while (length < 0 && errno == EINTR);
    return length == sizeof *answer;
}

#endif
