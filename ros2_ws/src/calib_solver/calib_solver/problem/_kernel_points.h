/* SPDX-License-Identifier: Apache-2.0
 * One pass over measured points that have one target and one station: included as _kernel_pass.h is,
 * behind it.
 */

/* how the flange turns with a column: about an axis, or not at all */
static void PASS(turning)(const Arm *arm, Frames *f, long which, const double *scale, lanes *column)
{
    const long n = arm->n;
    double factor = 1.0;
    lanes *axis = NULL, felt;
    memcpy(felt, scale, sizeof felt);
    if (which < 5 * n) {
        JointFrame *j = &f->joint[which % n];
        axis = which / n == 1 ? j->x : which / n == 3 ? j->z_joint : which / n == 4 ? j->y : NULL;
        factor = which / n == 3 ? -1.0 : 1.0;
    } else if (which >= 5 * n + 6) {
        const long i = (which - 5 * n - 6) % n;
        const double *basis = f->basis[(which - 5 * n - 6) / n][i];
        axis = arm->joint[i].slide < 0 ? f->joint[i].z_joint : NULL;
        factor = arm->joint[i].direction;
        for (int l = 0; l < LANES; ++l)
            felt[l] *= basis[l];
    }
    if (axis == NULL) {
        memset(column, 0, 3 * sizeof *column);
        return;
    }
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l)
            column[k][l] = factor * felt[l] * axis[k][l];
}

/* columns of the places: the target's translation and rotation in the flange, the base's in itself;
 * of positions, or (`point` NULL) of rotations */
static void PASS(places)(Frames *f, lanes *point, const double *scale, double *rows)
{
    lanes(*column)[3] = (lanes(*)[3])rows;
    memset(column, 0, 12 * sizeof *column);
    const int target = point ? 0 : 3, station = point ? 6 : 9;
    for (int axis = 0; axis < 3; ++axis) {
        PASS(slide)(column[target + axis], f->axis[axis], scale);
        for (int l = 0; l < LANES; ++l)
            column[station + axis][axis][l] = scale[l];
    }
    if (point == NULL)
        return;
    for (int axis = 0; axis < 3; ++axis) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (int l = 0; l < LANES; ++l) {
            column[9 + axis][u][l] = -scale[l] * point[v][l];
            column[9 + axis][v][l] = scale[l] * point[u][l];
        }
    }
}

/* the residuals behind all columns */
static void PASS(residual)(const double *residual, long begin, long size, const double *scale,
                           double *rows)
{
    lanes *column = (lanes *)rows;
    for (int l = 0; l < LANES; ++l) {
        const long row = begin + (l < size ? l : 0);
        for (int k = 0; k < 3; ++k)
            column[k][l] = scale[l] * residual[3 * row + k];
    }
}

static void PASS(points)(const Arm *arm, const JointTerms *terms, const Poses *poses,
                         const Columns *columns, const Seen *seen, long first, long last,
                         double *rows, double *normal, double *turn_normal)
{
    const long width = columns->padded, free = columns->count;
    Frames *f = (Frames *)(rows + width * 3 * LANES);
    double *places = rows + free * 3 * LANES, *behind = rows + (free + PLACES) * 3 * LANES;
    for (long begin = first; begin < last; begin += LANES) {
        const long size = last - begin < LANES ? last - begin : LANES;
        lanes scale, turned[3], point[3];
        PASS(place)(arm, terms, poses, begin, size, f, scale, turned, point);
        for (long c = 0; c < free; ++c)
            PASS(column)(arm, f, point, turned, columns->which[c], scale,
                         (lanes *)(rows + c * 3 * LANES));
        PASS(places)(f, point, scale, places);
        PASS(residual)(seen->position, begin, size, scale, behind);
        PASS(square)(rows, width, normal);
        if (turn_normal == NULL)
            continue;
        for (int l = 0; l < LANES; ++l)
            scale[l] = l < size ? sqrt(seen->turn_weight[begin + l]) : 0.0;
        for (long c = 0; c < free; ++c)
            PASS(turning)(arm, f, columns->which[c], scale, (lanes *)(rows + c * 3 * LANES));
        PASS(places)(f, NULL, scale, places);
        PASS(residual)(seen->turn, begin, size, scale, behind);
        PASS(square)(rows, width, turn_normal);
    }
}
