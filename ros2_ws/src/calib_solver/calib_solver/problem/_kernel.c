/* SPDX-License-Identifier: Apache-2.0
 * The passes over all poses behind calib_solver.problem.sphere_sums and over all measured points
 * behind calib_solver.points.solver, compiled. numpy does the same in accumulate_numpy and
 * accumulate_points_numpy there, and tests hold them equal.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES 32        /* poses in a block */
#define TILE 4          /* columns multiplied at a time */
#define WIDE 4          /* doubles in a vector */
#define MOST_JOINTS 16
#define MOST_TERMS 9    /* functions per joint by which it may be off what is read */
#define PLACES 12       /* columns of a target and a station */
#define MOUNT_SIZE 45   /* the probe's 21, the base's 12, the flange's 12 */

typedef double lanes[LANES];
typedef double vector __attribute__((vector_size(WIDE * sizeof(double))));

typedef struct {
    double a, d, cos_alpha, sin_alpha, cos_zero, sin_zero, cos_beta, sin_beta, direction;
    long slide; /* row of `slide` of a joint that slides, -1 of one that turns */
} JointConstants;

typedef struct {
    int n;
    JointConstants joint[MOST_JOINTS];
    double mount[3][3], place[3], probe_axis[3][3];
    double base[3][3], base_place[3], flange[3][3], flange_place[3];
    int plain_flange;
} Arm;

typedef struct {
    lanes z_joint[3], o_joint[3], x[3], y[3], o[3];
} JointFrame;

typedef struct {
    JointFrame joint[MOST_JOINTS];
    lanes axis[3][3], origin[3];
    lanes cosine[MOST_JOINTS], sine[MOST_JOINTS], slide[MOST_JOINTS]; /* where each joint is */
    lanes basis[MOST_TERMS][MOST_JOINTS];
} Frames;

typedef struct {
    long count, slides;
    const double *cosine, *sine, *slide, *centers, *weight;
} Poses;

/* A joint is off by sum_t values[t] basis_t: cos(k q), sin(k q) for k = 1 .. harmonics of one that
 * turns, and the others as they are given: the travel of one that slides, the torque on it. */
typedef struct {
    long count, harmonics;
    const double *values, *given;
} JointTerms;

typedef struct {
    long count, padded;
    const long long *which;
} Columns;

typedef struct {
    double *weight, *reference, *moment, *spread, *jacobian, *normal;
} SphereOut;

/* what a tracker measured, predicted less measured, with the weights of rotations */
typedef struct {
    const double *position, *turn_weight, *turn;
} Seen;

#define PASS(name) name##_plain
#include "_kernel_pass.h"
#include "_kernel_points.h"
#undef PASS

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define HAVE_WIDE 1
#pragma GCC push_options
#pragma GCC target("avx2,fma")
#define PASS(name) name##_avx2
#include "_kernel_pass.h"
#include "_kernel_points.h"
#undef PASS
#pragma GCC pop_options
#endif

static int wide(void)
{
#ifdef HAVE_WIDE
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
    return 0;
#endif
}

#ifndef HAVE_WIDE
#define sphere_avx2 sphere_plain
#define points_avx2 points_plain
#endif

static void set_arm(Arm *arm, const double *geometry, const double *mount, const double *direction,
                    const long long *slide)
{
    const int n = arm->n;
    for (int i = 0; i < n; ++i) {
        JointConstants *j = &arm->joint[i];
        const double alpha = geometry[n + i], zero = geometry[3 * n + i];
        const double beta = geometry[4 * n + i];
        *j = (JointConstants){geometry[i], geometry[2 * n + i], cos(alpha), sin(alpha),
                              cos(zero),   sin(zero),           cos(beta),  sin(beta),
                              direction[i], (long)slide[i]};
    }
    /* mount: rotation by rows, translation, then the axes about which each rotation
     * parameter turns the probe; then the transforms before the first joint and behind the last */
    arm->plain_flange = 1;
    for (int k = 0; k < 3; ++k) {
        for (int m = 0; m < 3; ++m) {
            arm->mount[k][m] = mount[3 * k + m];
            arm->probe_axis[k][m] = mount[12 + 3 * k + m];
            arm->base[k][m] = mount[21 + 3 * k + m];
            arm->flange[k][m] = mount[33 + 3 * k + m];
            arm->plain_flange &= arm->flange[k][m] == (k == m);
        }
        arm->place[k] = mount[9 + k];
        arm->base_place[k] = mount[30 + k];
        arm->flange_place[k] = mount[42 + k];
        arm->plain_flange &= arm->flange_place[k] == 0.0;
    }
}

/* the first of the inputs are those of both passes */
enum {
    COSINE, SINE, SLIDE, CENTERS, WEIGHT, START, GEOMETRY, DIRECTION, SLIDES, MOUNT, COLUMNS, VALUES,
    GIVEN, INPUTS
};
enum { POSITION = INPUTS, TURN_WEIGHT, TURN, POINT_INPUTS };
enum { OUT_WEIGHT, OUT_REFERENCE, OUT_MOMENT, OUT_SPREAD, OUT_JACOBIAN, OUT_NORMAL, OUTPUTS };
enum { OUT_POSITION, OUT_TURN, POINT_OUTPUTS };

typedef struct {
    Arm arm;
    Poses poses;
    JointTerms terms;
    Columns columns;
    long groups; /* spheres, or points of one target and station */
    const long long *start;
} Task;

static int sizes_fit(const Py_buffer *in, const Task *task)
{
    const Py_ssize_t word = 8, n = task->arm.n, count = task->poses.count;
    const Py_ssize_t given = task->terms.count - 2 * task->terms.harmonics;
    int fit = in[COSINE].len == n * count * word && in[SINE].len == in[COSINE].len
              && in[CENTERS].len == 3 * count * word && in[GEOMETRY].len == 5 * n * word
              && in[MOUNT].len == MOUNT_SIZE * word && in[DIRECTION].len == n * word
              && in[SLIDES].len == n * word && in[SLIDE].len == task->poses.slides * count * word
              && in[VALUES].len == task->terms.count * n * word && task->terms.count <= MOST_TERMS
              && given >= 0 && in[GIVEN].len == given * n * count * word;
    for (long s = 0; fit && s < task->groups; ++s)
        fit = task->start[s] >= 0 && task->start[s] <= task->start[s + 1]
              && task->start[s + 1] <= count;
    for (long c = 0; fit && c < task->columns.count; ++c)
        fit = task->columns.which[c] >= 0
              && task->columns.which[c] < 5 * n + 6 + task->terms.count * n;
    const long long *slide = in[SLIDES].buf;
    for (long i = 0; fit && i < n; ++i)
        fit = slide[i] >= -1 && slide[i] < task->poses.slides;
    return fit;
}

/* what both passes take; `behind` columns stand behind those of the parameters */
static int set_task(Task *task, const Py_buffer *in, long behind, long first, long last)
{
    const long count = (long)(in[WEIGHT].len / 8), n = (long)(in[GEOMETRY].len / (5 * 8));
    task->arm.n = (int)n;
    task->groups = (long)(in[START].len / 8) - 1;
    task->start = in[START].buf;
    task->poses = (Poses){count, count ? (long)(in[SLIDE].len / 8 / count) : 0, in[COSINE].buf,
                          in[SINE].buf, in[SLIDE].buf, in[CENTERS].buf, in[WEIGHT].buf};
    const long terms = n ? (long)(in[VALUES].len / 8 / n) : 0;
    const long given = n && count ? (long)(in[GIVEN].len / 8 / n / count) : 0;
    task->terms = (JointTerms){terms, (terms - given) / 2, in[VALUES].buf, in[GIVEN].buf};
    task->columns = (Columns){(long)(in[COLUMNS].len / 8), 0, in[COLUMNS].buf};
    task->columns.padded = (task->columns.count + behind + TILE - 1) / TILE * TILE;
    if (n < 1 || n > MOST_JOINTS || first < 0 || last > task->groups || !sizes_fit(in, task))
        return 0;
    set_arm(&task->arm, in[GEOMETRY].buf, in[MOUNT].buf, in[DIRECTION].buf, in[SLIDES].buf);
    return 1;
}

/* a block's rows, zero at first, and its frames behind them */
static double *new_rows(const Task *task)
{
    const size_t bytes = (size_t)task->columns.padded * 3 * LANES * sizeof(double);
    double *rows = aligned_alloc(64, (bytes + sizeof(Frames) + 63) / 64 * 64);
    if (rows != NULL)
        memset(rows, 0, bytes);
    return rows;
}

static int run(const Py_buffer *in, const Py_buffer *out, long first, long last)
{
    Task task;
    if (!set_task(&task, in, 1, first, last))
        return -1;
    const Py_ssize_t f = task.columns.count, p = task.columns.padded, s = task.groups;
    const Py_ssize_t wanted[OUTPUTS] = {s, 3 * s, 3 * s, 3 * s, 3 * f * s, p * p * s};
    for (int i = 0; i < OUTPUTS; ++i)
        if (out[i].len != wanted[i] * 8)
            return -1;
    double *rows = new_rows(&task);
    if (rows == NULL)
        return -2;
    Py_BEGIN_ALLOW_THREADS
    for (long g = first; g < last; ++g) {
        const SphereOut own = {
            (double *)out[OUT_WEIGHT].buf + g,       (double *)out[OUT_REFERENCE].buf + 3 * g,
            (double *)out[OUT_MOMENT].buf + 3 * g,   (double *)out[OUT_SPREAD].buf + 3 * g,
            (double *)out[OUT_JACOBIAN].buf + 3 * f * g, (double *)out[OUT_NORMAL].buf + p * p * g};
        (wide() ? sphere_avx2 : sphere_plain)(&task.arm, &task.terms, &task.poses, &task.columns,
                                              task.start[g], task.start[g + 1], rows, own);
    }
    Py_END_ALLOW_THREADS
    free(rows);
    return 0;
}

static int run_points(const Py_buffer *in, const Py_buffer *out, long first, long last)
{
    Task task;
    if (!set_task(&task, in, PLACES + 1, first, last))
        return -1;
    const Py_ssize_t count = task.poses.count, p = task.columns.padded, s = task.groups;
    const int turns = in[TURN_WEIGHT].len > 0;
    if (in[POSITION].len != 3 * count * 8 || in[TURN_WEIGHT].len != turns * count * 8
        || in[TURN].len != 3 * turns * count * 8 || out[OUT_POSITION].len != p * p * s * 8
        || out[OUT_TURN].len != turns * p * p * s * 8)
        return -1;
    const Seen seen = {in[POSITION].buf, in[TURN_WEIGHT].buf, in[TURN].buf};
    double *rows = new_rows(&task);
    if (rows == NULL)
        return -2;
    Py_BEGIN_ALLOW_THREADS
    for (long g = first; g < last; ++g) {
        double *turn = turns ? (double *)out[OUT_TURN].buf + p * p * g : NULL;
        (wide() ? points_avx2 : points_plain)(&task.arm, &task.terms, &task.poses, &task.columns,
                                              &seen, task.start[g], task.start[g + 1], rows,
                                              (double *)out[OUT_POSITION].buf + p * p * g, turn);
    }
    Py_END_ALLOW_THREADS
    free(rows);
    return 0;
}

enum { MOST_INPUTS = POINT_INPUTS, MOST_OUTPUTS = OUTPUTS };

static int hold(PyObject *arrays, int count, int flags, Py_buffer *views)
{
    for (int i = 0; i < count; ++i)
        if (PyObject_GetBuffer(PyTuple_GET_ITEM(arrays, i), &views[i], flags)) {
            while (i > 0)
                PyBuffer_Release(&views[--i]);
            return 0;
        }
    return 1;
}

static void release(Py_buffer *views, int count)
{
    while (count > 0)
        PyBuffer_Release(&views[--count]);
}

static PyObject *passed(PyObject *args, int count_in, int count_out,
                        int (*pass)(const Py_buffer *, const Py_buffer *, long, long))
{
    PyObject *inputs, *outputs;
    long first, last;
    if (!PyArg_ParseTuple(args, "O!O!ll", &PyTuple_Type, &inputs, &PyTuple_Type, &outputs, &first,
                          &last))
        return NULL;
    if (PyTuple_GET_SIZE(inputs) != count_in || PyTuple_GET_SIZE(outputs) != count_out)
        return PyErr_Format(PyExc_ValueError, "expected %d inputs and %d outputs", count_in,
                            count_out);
    Py_buffer in[MOST_INPUTS], out[MOST_OUTPUTS];
    if (!hold(inputs, count_in, PyBUF_C_CONTIGUOUS, in))
        return NULL;
    if (!hold(outputs, count_out, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE, out)) {
        release(in, count_in);
        return NULL;
    }
    const int outcome = pass(in, out, first, last);
    release(in, count_in);
    release(out, count_out);
    if (outcome == -1)
        PyErr_SetString(PyExc_ValueError, "the arrays' sizes do not go together");
    else if (outcome == -2)
        PyErr_NoMemory();
    if (outcome)
        return NULL;
    Py_RETURN_NONE;
}

PyDoc_STRVAR(accumulate_doc,
"accumulate(inputs, outputs, first, last)\n--\n\n"
"Add the sums of the spheres from `first` to before `last` to zeroed `outputs`.\n\n"
"inputs: cosine (n, N), sine (n, N), slide (P, N), centers (N, 3), weight (N,),\n"
"start (S + 1,) int64, geometry (5, n), direction (n,), slides (n,) int64, mount (45,),\n"
"columns (F,) int64, values (T, n), the last E functions, which are no harmonics, (E, n, N).\n"
"outputs: weight (S,), reference (S, 3),\n"
"moment (S, 3), spread (S, 3), jacobian (S, 3, F), normal (S, P, P) with P = F + 1 rounded up\n"
"to a multiple of 4, upper tiles only, its column F the deviations. All C-contiguous.\n"
"Raises ValueError when the sizes do not go together.");

static PyObject *accumulate(PyObject *module, PyObject *args)
{
    return passed(args, INPUTS, OUTPUTS, run);
}

PyDoc_STRVAR(accumulate_points_doc,
"accumulate_points(inputs, outputs, first, last)\n--\n\n"
"The same of measured points, each group of one target and one station.\n\n"
"inputs: as of `accumulate`, `centers` the targets on the flange; then residuals position (N, 3),\n"
"turn_weight (N,) and turn (N, 3), (0,) where there are no rotations.\n"
"outputs: of positions and of rotations normal (S, P, P), the latter (0,) without, with\n"
"P = F + 13 rounded up to a multiple of 4, upper tiles only: columns F to F + 11 are the target's\n"
"and the station's, F + 12 the residuals.");

static PyObject *accumulate_points(PyObject *module, PyObject *args)
{
    return passed(args, POINT_INPUTS, POINT_OUTPUTS, run_points);
}

static PyMethodDef methods[] = {
    {"accumulate", accumulate, METH_VARARGS, accumulate_doc},
    {"accumulate_points", accumulate_points, METH_VARARGS, accumulate_points_doc},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_kernel", NULL, -1, methods,
                                    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void)
{
    return PyModule_Create(&module);
}
