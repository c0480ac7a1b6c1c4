/* SPDX-License-Identifier: Apache-2.0
 * The pass over all poses behind calib_solver.problem.sphere_sums, compiled. numpy does the same in
 * calib_solver.problem.sphere_sums.accumulate_numpy, and a test holds the two equal.
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

/* A joint is off by sum_t values[t] basis_t: cos(k q), sin(k q) for k = 1 .. count / 2 and, where
 * count is odd, the torque on it at last. */
typedef struct {
    long count;
    const double *values, *torque;
} JointTerms;

typedef struct {
    long count, padded;
    const long long *which;
} Columns;

typedef struct {
    double *weight, *reference, *moment, *spread, *jacobian, *normal;
} SphereOut;

#define PASS(name) name##_plain
#include "_kernel_pass.h"
#undef PASS

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define HAVE_WIDE 1
#pragma GCC push_options
#pragma GCC target("avx2,fma")
#define PASS(name) name##_avx2
#include "_kernel_pass.h"
#undef PASS
#pragma GCC pop_options
#endif

static void pass_sphere(const Arm *arm, const JointTerms *terms, const Poses *poses,
                        const Columns *columns, long first, long last, double *rows, SphereOut out)
{
#ifdef HAVE_WIDE
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        sphere_avx2(arm, terms, poses, columns, first, last, rows, out);
        return;
    }
#endif
    sphere_plain(arm, terms, poses, columns, first, last, rows, out);
}

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

enum {
    COSINE, SINE, SLIDE, CENTERS, WEIGHT, START, GEOMETRY, DIRECTION, SLIDES, MOUNT, COLUMNS, VALUES,
    TORQUE, INPUTS
};
enum { OUT_WEIGHT, OUT_REFERENCE, OUT_MOMENT, OUT_SPREAD, OUT_JACOBIAN, OUT_NORMAL, OUTPUTS };

static int sizes_fit(const Py_buffer *in, const Py_buffer *out, const Arm *arm,
                     const JointTerms *terms, const Poses *poses, const Columns *columns,
                     long spheres)
{
    const Py_ssize_t word = 8, n = arm->n, f = columns->count, p = columns->padded;
    const Py_ssize_t torques = terms->count % 2 ? n * poses->count : 0;
    const Py_ssize_t wanted[OUTPUTS] = {spheres, 3 * spheres, 3 * spheres, 3 * spheres,
                                        3 * f * spheres, p * p * spheres};
    int fit = in[COSINE].len == n * poses->count * word && in[SINE].len == in[COSINE].len
              && in[CENTERS].len == 3 * poses->count * word && in[GEOMETRY].len == 5 * n * word
              && in[MOUNT].len == MOUNT_SIZE * word && in[DIRECTION].len == n * word
              && in[SLIDES].len == n * word && in[SLIDE].len == poses->slides * poses->count * word
              && in[VALUES].len == terms->count * n * word && terms->count <= MOST_TERMS
              && in[TORQUE].len == torques * word;
    for (int i = 0; i < OUTPUTS; ++i)
        fit = fit && out[i].len == wanted[i] * word;
    const long long *start = in[START].buf;
    for (long s = 0; fit && s < spheres; ++s)
        fit = start[s] >= 0 && start[s] <= start[s + 1] && start[s + 1] <= poses->count;
    for (long c = 0; fit && c < f; ++c)
        fit = columns->which[c] >= 0 && columns->which[c] < 5 * n + 6 + terms->count * n;
    const long long *slide = in[SLIDES].buf;
    for (long i = 0; fit && i < n; ++i)
        fit = slide[i] >= -1 && slide[i] < poses->slides;
    return fit;
}

static int run(const Py_buffer *in, const Py_buffer *out, long first, long last)
{
    Arm arm;
    arm.n = (int)(in[GEOMETRY].len / (5 * 8));
    const long spheres = (long)(in[START].len / 8) - 1;
    const long count = (long)(in[WEIGHT].len / 8);
    const Poses poses = {count, count ? (long)(in[SLIDE].len / 8 / count) : 0, in[COSINE].buf,
                         in[SINE].buf, in[SLIDE].buf, in[CENTERS].buf, in[WEIGHT].buf};
    const JointTerms terms = {arm.n ? (long)(in[VALUES].len / 8 / arm.n) : 0, in[VALUES].buf,
                              in[TORQUE].buf};
    Columns columns = {(long)(in[COLUMNS].len / 8), 0, in[COLUMNS].buf};
    columns.padded = (columns.count + 1 + TILE - 1) / TILE * TILE;
    if (arm.n < 1 || arm.n > MOST_JOINTS || first < 0 || last > spheres
        || !sizes_fit(in, out, &arm, &terms, &poses, &columns, spheres))
        return -1;
    set_arm(&arm, in[GEOMETRY].buf, in[MOUNT].buf, in[DIRECTION].buf, in[SLIDES].buf);
    const size_t row_bytes = (size_t)columns.padded * 3 * LANES * sizeof(double);
    double *rows = aligned_alloc(64, (row_bytes + sizeof(Frames) + 63) / 64 * 64);
    if (rows == NULL)
        return -2;
    memset(rows, 0, row_bytes);
    const long long *start = in[START].buf;
    const long f = columns.count, p = columns.padded;
    Py_BEGIN_ALLOW_THREADS
    for (long s = first; s < last; ++s) {
        const SphereOut own = {
            (double *)out[OUT_WEIGHT].buf + s,       (double *)out[OUT_REFERENCE].buf + 3 * s,
            (double *)out[OUT_MOMENT].buf + 3 * s,   (double *)out[OUT_SPREAD].buf + 3 * s,
            (double *)out[OUT_JACOBIAN].buf + 3 * f * s, (double *)out[OUT_NORMAL].buf + p * p * s};
        pass_sphere(&arm, &terms, &poses, &columns, start[s], start[s + 1], rows, own);
    }
    Py_END_ALLOW_THREADS
    free(rows);
    return 0;
}

PyDoc_STRVAR(accumulate_doc,
"accumulate(inputs, outputs, first, last)\n--\n\n"
"Add the sums of the spheres from `first` to before `last` to zeroed `outputs`.\n\n"
"inputs: cosine (n, N), sine (n, N), slide (P, N), centers (N, 3), weight (N,),\n"
"start (S + 1,) int64, geometry (5, n), direction (n,), slides (n,) int64, mount (45,),\n"
"columns (F,) int64, values (T, n), torque (n, N) where T is odd and else (0,).\n"
"outputs: weight (S,), reference (S, 3),\n"
"moment (S, 3), spread (S, 3), jacobian (S, 3, F), normal (S, P, P) with P = F + 1 rounded up\n"
"to a multiple of 4, upper tiles only, its column F the deviations. All C-contiguous.\n"
"Raises ValueError when the sizes do not go together.");

static PyObject *accumulate(PyObject *module, PyObject *args)
{
    PyObject *inputs, *outputs;
    long first, last;
    if (!PyArg_ParseTuple(args, "O!O!ll", &PyTuple_Type, &inputs, &PyTuple_Type, &outputs, &first,
                          &last))
        return NULL;
    if (PyTuple_GET_SIZE(inputs) != INPUTS || PyTuple_GET_SIZE(outputs) != OUTPUTS) {
        PyErr_SetString(PyExc_ValueError, "expected 13 inputs and 6 outputs");
        return NULL;
    }
    Py_buffer in[INPUTS], out[OUTPUTS];
    int held_in = 0, held_out = 0, failed = 0;
    while (held_in < INPUTS && !failed) {
        failed = PyObject_GetBuffer(PyTuple_GET_ITEM(inputs, held_in), &in[held_in],
                                    PyBUF_C_CONTIGUOUS);
        held_in += !failed;
    }
    while (held_out < OUTPUTS && !failed) {
        failed = PyObject_GetBuffer(PyTuple_GET_ITEM(outputs, held_out), &out[held_out],
                                    PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE);
        held_out += !failed;
    }
    if (!failed) {
        const int outcome = run(in, out, first, last);
        if (outcome == -1)
            PyErr_SetString(PyExc_ValueError, "the arrays' sizes do not go together");
        else if (outcome == -2)
            PyErr_NoMemory();
        failed = outcome;
    }
    while (held_in > 0)
        PyBuffer_Release(&in[--held_in]);
    while (held_out > 0)
        PyBuffer_Release(&out[--held_out]);
    if (failed)
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {{"accumulate", accumulate, METH_VARARGS, accumulate_doc},
                                {NULL, NULL, 0, NULL}};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_kernel", NULL, -1, methods,
                                    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void)
{
    return PyModule_Create(&module);
}
