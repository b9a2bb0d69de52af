// SPDX-License-Identifier: Apache-2.0
// Gravity while drilling in C, for a controller without a floating-point unit: the fuzzy filter of paper S3 and the
// Kalman filter that S3 compares it with, as in mwd_estimation/gravity (fuzzy_mahony.py, ligorio_kalman.py), without the
// bookkeeping of sigma and status. Parameters are the defaults there; a test compares the numbers.
#ifndef GRAVITY_FILTERS_H
#define GRAVITY_FILTERS_H

#include <math.h>
#include <string.h>

#ifdef DOUBLE  // on another machine, to compare with the Python kernels digit by digit
typedef double real;
#else
typedef float real;
#define sqrt sqrtf
#define sin sinf
#define cos cosf
#define exp expf
#define fabs fabsf
#endif
#define R(number) ((real)(number))

#define GRAVITY R(9.80665)

typedef struct {
    real x, y, z;
} vec;

static inline vec add(vec a, vec b) { return (vec){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline vec scaled(vec a, real by) { return (vec){a.x * by, a.y * by, a.z * by}; }
static inline real dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline vec cross(vec a, vec b) {
    return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline real length(vec a) { return sqrt(dot(a, a)); }

// exp(-[p x]) g: a vector fixed in space, in axes turned by the rotation vector p, rad (S3 eq 5).
static vec in_turned_axes(vec g, vec p) {
    real angle2 = dot(p, p), s, c;
    if (angle2 < R(0.01)) {
        s = R(1) - angle2 * R(1.0 / 6) * (R(1) - angle2 * R(1.0 / 20) * (R(1) - angle2 * R(1.0 / 42)));
        c = R(0.5) - angle2 * R(1.0 / 24) * (R(1) - angle2 * R(1.0 / 30) * (R(1) - angle2 * R(1.0 / 56)));
    } else {
        real angle = sqrt(angle2);
        s = sin(angle) / angle;
        c = (R(1) - cos(angle)) / angle2;
    }
    vec a = cross(g, p), b = cross(a, p);
    return add(g, add(scaled(a, s), scaled(b, c)));
}

// Rotation vector of a sample with the coning term of S3 eq 5; last, now: rotation angles, rad; share: of the term.
static vec coning_rotation(vec last, vec now, real share) { return add(now, scaled(cross(last, now), share / R(12))); }

// ---- The fuzzy filter: recursion, correction and gain of S3 section 2.

#define WINDOW 20
#define FUZZY_K_P R(0.15)
#define FUZZY_K_I R(0.003)
#define FUZZY_K_P_LEAST R(0.01)
#define FUZZY_START_S R(2)
#define ROTARY_LAG_S R(0.5)

typedef struct {
    vec down, integral, last_angle, mean;
    real age, rotary_speed, ring[WINDOW];
    int ring_at, started;
} fuzzy_state;

static void membership(real value, real middle, real m[3]) {
    m[0] = m[1] = m[2] = R(0);
    real at = value / middle;
    if (at <= R(0)) m[0] = R(1);
    else if (at >= R(2)) m[2] = R(1);
    else if (at <= R(1)) m[1] = at, m[0] = R(1) - at;
    else m[2] = at - R(1), m[1] = R(2) - at;
}

// Change of k_p, 1/s, by S3 table 1 and eq 13.
static real fuzzy_step(real non_gravity, real rotary_rpm) {
    static const real rules[3][3] = {{R(0.06), R(0.03), R(-0.03)}, {R(0), R(0), R(-0.03)}, {R(0), R(-0.03), R(-0.06)}};
    real v[3], r[3], top = R(0), bottom = R(0);
    membership(non_gravity, R(25), v);
    membership(fabs(rotary_rpm), R(100), r);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            real weight = r[i] < v[j] ? r[i] : v[j];
            top += weight * rules[i][j];
            bottom += weight;
        }
    return top / bottom;
}

// One sample: dt, s; w, rad/s; f, m/s^2, up at rest. The direction of gravity is left in s->down.
static void fuzzy_update(fuzzy_state *s, real dt, vec w, vec f) {
    vec u = scaled(f, R(-1) / GRAVITY), angle = scaled(w, dt);
    vec turn = coning_rotation(s->last_angle, angle, R(0));
    s->last_angle = angle;
    s->age += dt;
    if (s->age < FUZZY_START_S || !s->started) {
        s->started = 1;
        s->mean = add(in_turned_axes(s->mean, turn), scaled(u, dt > R(1e-3) ? dt : R(1e-3)));
        s->down = scaled(s->mean, R(1) / length(s->mean));
    } else {
        vec h = in_turned_axes(s->down, turn), e = cross(u, h);
        s->ring[s->ring_at] = GRAVITY * length(add(u, scaled(h, R(-1))));
        s->ring_at = (s->ring_at + 1) % WINDOW;
        real most = R(0);
        for (int k = 0; k < WINDOW; k++)
            if (s->ring[k] > most) most = s->ring[k];
        real gain = FUZZY_K_P + fuzzy_step(most, s->rotary_speed * R(9.549296585513721));
        if (gain < FUZZY_K_P_LEAST) gain = FUZZY_K_P_LEAST;
        if (gain * s->age < R(1)) gain = R(1) / s->age;
        s->integral = add(s->integral, scaled(e, FUZZY_K_I * dt));
        vec g = in_turned_axes(s->down, add(turn, scaled(add(scaled(e, gain), s->integral), dt)));
        s->down = scaled(g, R(1) / length(g));
    }
    s->rotary_speed += dt / (ROTARY_LAG_S + dt) * (w.x - s->rotary_speed);
}

// ---- The Kalman filter: gravity and acceleration of the tool, the accelerometer measures their difference.

#define KALMAN_GYRO_NOISE R(0.01)
#define KALMAN_RATE_NOISE R(0.005)
#define KALMAN_ACCEL_NOISE R(0.5)
#define KALMAN_MOTION R(10)
#define KALMAN_MEMORY_S R(0.05)
#define KALMAN_BIAS_GAIN R(0.005)

typedef struct {
    vec gravity, acceleration, last_angle, bias;
    real p[6][6];  // reduced: p[0][0], p[0][3] and p[3][3] are the three numbers times the unit matrix
    int started;
} kalman_state;

static void kalman_begin(kalman_state *s, vec f) {
    s->started = 1;
    s->gravity = scaled(f, -GRAVITY / length(f));
    for (int k = 0; k < 3; k++) {
        s->p[k][k] = (R(0.5) * GRAVITY) * (R(0.5) * GRAVITY);
        s->p[k + 3][k + 3] = KALMAN_MOTION * KALMAN_MOTION;
    }
}

// What both forms share before the covariance: rotation vector of the sample, and decay of the acceleration.
static vec kalman_turn(kalman_state *s, real dt, vec w, real *keep) {
    vec angle = scaled(add(w, s->bias), dt), turn = coning_rotation(s->last_angle, angle, R(0));
    s->last_angle = angle;
    *keep = exp(-dt / KALMAN_MEMORY_S);
    return turn;
}

static real kalman_gravity_noise(real dt, vec w) {
    return GRAVITY * GRAVITY * dt *
           (KALMAN_GYRO_NOISE * KALMAN_GYRO_NOISE + KALMAN_RATE_NOISE * KALMAN_RATE_NOISE * dot(w, w));
}

static void kalman_bias(kalman_state *s, real dt, vec f) {
    s->bias = add(s->bias, scaled(cross(f, s->gravity), -KALMAN_BIAS_GAIN * dt / (GRAVITY * GRAVITY)));
}

// As in ligorio_kalman.py: equal noise on the three axes makes the 6 x 6 covariance three numbers.
static void kalman_update_reduced(kalman_state *s, real dt, vec w, vec f) {
    if (!s->started) kalman_begin(s, f);
    real keep, *gg = &s->p[0][0], *ga = &s->p[0][3], *aa = &s->p[3][3];
    vec turn = kalman_turn(s, dt, w, &keep);
    s->gravity = in_turned_axes(s->gravity, turn);
    s->acceleration = scaled(in_turned_axes(s->acceleration, turn), keep);
    *gg += kalman_gravity_noise(dt, w);
    *ga *= keep;
    *aa = keep * keep * *aa + (R(1) - keep * keep) * KALMAN_MOTION * KALMAN_MOTION;
    kalman_bias(s, dt, f);
    vec y = add(add(f, s->gravity), scaled(s->acceleration, R(-1)));
    real cg = *ga - *gg, ca = *aa - *ga, total = ca - cg + KALMAN_ACCEL_NOISE * KALMAN_ACCEL_NOISE;
    real kg = cg / total, ka = ca / total;
    s->gravity = add(s->gravity, scaled(y, kg));
    s->acceleration = add(s->acceleration, scaled(y, ka));
    *gg -= kg * cg;
    *ga -= kg * ca;
    *aa -= ka * ca;
    s->gravity = scaled(s->gravity, GRAVITY / length(s->gravity));
}

// out (n x m) = a (n x k) b (k x m), or b transposed, as a plain matrix library does it.
static void multiply(int n, int k, int m, const real *a, const real *b, int transposed, real *out) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < m; j++) {
            real sum = R(0);
            for (int c = 0; c < k; c++) sum += a[i * k + c] * (transposed ? b[j * k + c] : b[c * m + j]);
            out[i * m + j] = sum;
        }
}

static void inverse(const real a[3][3], real out[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int p = (j + 1) % 3, q = (j + 2) % 3, r = (i + 1) % 3, t = (i + 2) % 3;
            out[i][j] = a[p][r] * a[q][t] - a[p][t] * a[q][r];
        }
    real determinant = a[0][0] * out[0][0] + a[0][1] * out[1][0] + a[0][2] * out[2][0];
    for (int i = 0; i < 9; i++) (&out[0][0])[i] /= determinant;
}

// The same filter written with matrices, as S3 describes it: products of 6 x 6 matrices and a 3 x 3 inverse,
// covariance (I - K H) P as in the textbooks.
static void kalman_update_full(kalman_state *s, real dt, vec w, vec f) {
    static const real h[3][6] = {{R(-1), 0, 0, R(1), 0, 0}, {0, R(-1), 0, 0, R(1), 0}, {0, 0, R(-1), 0, 0, R(1)}};
    real keep, transition[6][6] = {{0}}, some[6][6], pht[6][3], hpht[3][3], inverted[3][3], k[6][3], state[6], next[6];
    if (!s->started) kalman_begin(s, f);
    vec turn = kalman_turn(s, dt, w, &keep);
    for (int j = 0; j < 3; j++) {
        vec column = in_turned_axes((vec){j == 0, j == 1, j == 2}, turn);
        transition[0][j] = column.x, transition[1][j] = column.y, transition[2][j] = column.z;
        for (int i = 0; i < 3; i++) transition[i + 3][j + 3] = keep * transition[i][j];
    }
    memcpy(state, &s->gravity, sizeof s->gravity);
    memcpy(state + 3, &s->acceleration, sizeof s->acceleration);
    multiply(6, 6, 1, &transition[0][0], state, 0, next);
    multiply(6, 6, 6, &transition[0][0], &s->p[0][0], 0, &some[0][0]);
    multiply(6, 6, 6, &some[0][0], &transition[0][0], 1, &s->p[0][0]);
    real of_gravity = kalman_gravity_noise(dt, w), of_motion = (R(1) - keep * keep) * KALMAN_MOTION * KALMAN_MOTION;
    for (int i = 0; i < 3; i++) s->p[i][i] += of_gravity, s->p[i + 3][i + 3] += of_motion;
    memcpy(&s->gravity, next, sizeof s->gravity);
    kalman_bias(s, dt, f);
    real expected[3], y[3] = {f.x, f.y, f.z}, change[6];
    multiply(3, 6, 1, &h[0][0], next, 0, expected);
    for (int i = 0; i < 3; i++) y[i] -= expected[i];
    multiply(6, 6, 3, &s->p[0][0], &h[0][0], 1, &pht[0][0]);
    multiply(3, 6, 3, &h[0][0], &pht[0][0], 0, &hpht[0][0]);
    for (int i = 0; i < 3; i++) hpht[i][i] += KALMAN_ACCEL_NOISE * KALMAN_ACCEL_NOISE;
    inverse(hpht, inverted);
    multiply(6, 3, 3, &pht[0][0], &inverted[0][0], 0, &k[0][0]);
    multiply(6, 3, 1, &k[0][0], y, 0, change);
    for (int i = 0; i < 6; i++) next[i] += change[i];
    multiply(6, 3, 6, &k[0][0], &h[0][0], 0, &some[0][0]);
    for (int i = 0; i < 36; i++) (&some[0][0])[i] = (i % 7 ? R(0) : R(1)) - (&some[0][0])[i];
    memcpy(transition, s->p, sizeof s->p);
    multiply(6, 6, 6, &some[0][0], &transition[0][0], 0, &s->p[0][0]);
    memcpy(&s->gravity, next, sizeof s->gravity);
    memcpy(&s->acceleration, next + 3, sizeof s->acceleration);
    s->gravity = scaled(s->gravity, GRAVITY / length(s->gravity));
}

#endif
