/* PD of the position and P of the attitude, for vehicles commanded by body rates: cc -O2 -o pd pd.c -lm; ./pd /run/oqtal/default/law
 * The same law as pd.py. */
#include <math.h>
#include <stdio.h>

#include "oqtal_law.h"

static double limited(double value, double limit)
{
    return fmax(-limit, fmin(limit, value));
}

/* Body components of the world vector `v` in the attitude `q`. */
static void to_body(const double q[4], const double v[3], double out[3])
{
    double t[3] = {2 * (v[1] * q[2] - v[2] * q[1]), 2 * (v[2] * q[0] - v[0] * q[2]), 2 * (v[0] * q[1] - v[1] * q[0])};
    out[0] = v[0] + q[3] * t[0] + t[1] * q[2] - t[2] * q[1];
    out[1] = v[1] + q[3] * t[1] + t[2] * q[0] - t[0] * q[2];
    out[2] = v[2] + q[3] * t[2] + t[0] * q[1] - t[1] * q[0];
}

static void command(const struct oqtal_state *s, struct oqtal_answer *answer)
{
    double wanted[3], force[3], up[3];
    for (int i = 0; i < 3; i++)
        wanted[i] = 4.0 * (s->reference_position[i] - s->position[i]) + 3.2 * (s->reference_velocity[i] - s->velocity[i]);
    double sideways = hypot(wanted[0], wanted[1]);
    double share = sideways > 2.6 ? 2.6 / sideways : 1.0;
    force[0] = s->mass * (share * wanted[0] - s->acceleration_bias[0]);
    force[1] = s->mass * (share * wanted[1] - s->acceleration_bias[1]);
    force[2] = s->mass * (limited(wanted[2], 4.0) - s->acceleration_bias[2] + s->gravity);
    to_body(s->attitude, force, up);
    double norm = sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]);
    const double *q = s->attitude;
    double yaw = atan2(2 * (q[3] * q[2] + q[0] * q[1]), 1 - 2 * (q[1] * q[1] + q[2] * q[2]));
    double turn[3] = {-up[1] / norm, up[0] / norm, remainder(s->reference_yaw - yaw, 2 * M_PI)};
    for (int i = 0; i < 3; i++)
        answer->rate[i] = limited(8.0 * turn[i] - s->demand_bias[i], s->greatest_rate[i]);
    answer->thrust = fmax(0.0, fmin(s->greatest_thrust, up[2]));
}

int main(int argc, char **argv)
{
    struct oqtal_state state;
    int law = argc == 2 ? oqtal_connect(argv[1]) : -1;
    if (law < 0) {
        fprintf(stderr, "usage: pd PATH, the socket `law` of an instance whose daemon runs\n");
        return 1;
    }
    unsigned long answers = 0;
    for (; oqtal_receive(law, &state); answers++) {
        struct oqtal_answer answer = {.attitude = {0, 0, 0, 0}};
        command(&state, &answer);
        oqtal_answer(law, &state, &answer);
    }
    if (errno == EPROTO) {
        fprintf(stderr, "%s: a question of another version: take oqtal_law.h of the daemon's version\n", argv[1]);
        return 1;
    }
    if (answers == 0) {
        fprintf(stderr, "%s: closed before the first question: end another law at this socket\n", argv[1]);
        return 1;
    }
    return 0;
}
