/* SPDX-License-Identifier: Apache-2.0
 * One pass over the poses of a range of spheres: included once per instruction set, with
 * PASS(name) giving each its own names.
 *
 * Poses go through in blocks of LANES, every quantity as an array over the block, so that the
 * compiler turns each loop into vector instructions and a block's Jacobian stays in cache.
 */

/* what the joints are off by, from the angles read: `basis`, and the angles as they are */
static void PASS(joint_errors)(const Arm *arm, const JointTerms *terms, Frames *f)
{
    const long harmonics = terms->harmonics;
    for (int i = 0; i < arm->n; ++i) {
        const double direction = arm->joint[i].direction;
        lanes c, s, off;
        for (int l = 0; l < LANES; ++l) {
            c[l] = f->cosine[i][l];
            s[l] = direction * f->sine[i][l];
            off[l] = 0.0;
        }
        for (long k = 0; k < harmonics; ++k) {
            double *cosine = f->basis[2 * k][i], *sine = f->basis[2 * k + 1][i];
            const double *before_c = k ? f->basis[2 * k - 2][i] : NULL;
            const double *before_s = k ? f->basis[2 * k - 1][i] : NULL;
            for (int l = 0; l < LANES; ++l) {
                cosine[l] = k ? before_c[l] * c[l] - before_s[l] * s[l] : c[l];
                sine[l] = k ? before_s[l] * c[l] + before_c[l] * s[l] : s[l];
            }
        }
        for (long t = 0; t < terms->count; ++t) {
            const double value = terms->values[t * arm->n + i];
            for (int l = 0; l < LANES; ++l) {
                /* a joint that slides has no angle */
                if (t < 2 * harmonics && arm->joint[i].slide >= 0)
                    f->basis[t][i][l] = 0.0;
                off[l] += value * f->basis[t][i][l];
            }
        }
        if (arm->joint[i].slide >= 0) {
            for (int l = 0; l < LANES; ++l)
                f->slide[i][l] += direction * off[l];
            continue;
        }
        for (int l = 0; l < LANES; ++l) {
            const double cosine = cos(off[l]), sine = direction * sin(off[l]);
            const double cq = f->cosine[i][l], sq = f->sine[i][l];
            f->cosine[i][l] = cq * cosine - sq * sine;
            f->sine[i][l] = sq * cosine + cq * sine;
        }
    }
}

static void PASS(frames)(const Arm *arm, Frames *f)
{
    lanes ax[3], az[3], ay[3], o[3];
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l) {
            ax[k][l] = arm->base[k][0];
            ay[k][l] = arm->base[k][1];
            az[k][l] = arm->base[k][2];
            o[k][l] = arm->base_place[k];
        }
    for (int i = 0; i < arm->n; ++i) {
        const JointConstants j = arm->joint[i];
        lanes c, s;
        for (int l = 0; l < LANES; ++l) {
            const double cq = f->cosine[i][l], sq = f->sine[i][l];
            c[l] = cq * j.cos_zero + sq * j.sin_zero;
            s[l] = sq * j.cos_zero - cq * j.sin_zero;
        }
        JointFrame *out = &f->joint[i];
        memcpy(out->z_joint, az, sizeof az);
        memcpy(out->o_joint, o, sizeof o);
        for (int k = 0; k < 3; ++k)
            for (int l = 0; l < LANES; ++l) {
                const double x = c[l] * ax[k][l] + s[l] * ay[k][l];
                const double turned = c[l] * ay[k][l] - s[l] * ax[k][l];
                const double y = j.cos_alpha * turned + j.sin_alpha * az[k][l];
                const double z = j.cos_alpha * az[k][l] - j.sin_alpha * turned;
                o[k][l] += (j.d + f->slide[i][l]) * az[k][l] + j.a * x;
                out->x[k][l] = x;
                ax[k][l] = j.cos_beta * x - j.sin_beta * z;
                ay[k][l] = y;
                az[k][l] = j.sin_beta * x + j.cos_beta * z;
            }
        memcpy(out->y, ay, sizeof ay);
        memcpy(out->o, o, sizeof o);
    }
    memcpy(f->axis[0], ax, sizeof ax);
    memcpy(f->axis[1], ay, sizeof ay);
    memcpy(f->axis[2], az, sizeof az);
    memcpy(f->origin, o, sizeof o);
    if (arm->plain_flange)
        return;
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l) {
            for (int m = 0; m < 3; ++m)
                f->axis[m][k][l] = ax[k][l] * arm->flange[0][m] + ay[k][l] * arm->flange[1][m]
                                   + az[k][l] * arm->flange[2][m];
            f->origin[k][l] += ax[k][l] * arm->flange_place[0] + ay[k][l] * arm->flange_place[1]
                               + az[k][l] * arm->flange_place[2];
        }
}

/* column = scale * factor * (axis x (point - through)), or scale * axis for a length */
static void PASS(turn)(lanes *column, lanes *axis, lanes *point, lanes *through,
                       const double *scale, double factor)
{
    for (int l = 0; l < LANES; ++l) {
        const double u = point[0][l] - through[0][l];
        const double v = point[1][l] - through[1][l];
        const double w = point[2][l] - through[2][l];
        const double k = factor * scale[l];
        column[0][l] = k * (axis[1][l] * w - axis[2][l] * v);
        column[1][l] = k * (axis[2][l] * u - axis[0][l] * w);
        column[2][l] = k * (axis[0][l] * v - axis[1][l] * u);
    }
}

static void PASS(slide)(lanes *column, lanes *axis, const double *scale)
{
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l)
            column[k][l] = scale[l] * axis[k][l];
}

static void PASS(along)(lanes *column, Frames *f, lanes *lever, const double *scale)
{
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l)
            column[k][l] = scale[l] * (f->axis[0][k][l] * lever[0][l] + f->axis[1][k][l] * lever[1][l]
                                       + f->axis[2][k][l] * lever[2][l]);
}

static void PASS(column)(const Arm *arm, Frames *f, lanes *point, lanes *turned, long which,
                         const double *scale, lanes *column)
{
    const long n = arm->n;
    if (which < 5 * n) {
        JointFrame *j = &f->joint[which % n];
        switch (which / n) {
        case 0: PASS(slide)(column, j->x, scale); return;
        case 1: PASS(turn)(column, j->x, point, j->o, scale, 1.0); return;
        case 2: PASS(slide)(column, j->z_joint, scale); return;
        case 3: PASS(turn)(column, j->z_joint, point, j->o_joint, scale, -1.0); return;
        default: PASS(turn)(column, j->y, point, j->o, scale, 1.0); return;
        }
    }
    which -= 5 * n;
    if (which >= 6) {
        const long i = (which - 6) % n;
        const double *basis = f->basis[(which - 6) / n][i];
        lanes felt;
        for (int l = 0; l < LANES; ++l)
            felt[l] = scale[l] * basis[l] * (arm->joint[i].slide < 0 ? 1.0 : arm->joint[i].direction);
        if (arm->joint[i].slide >= 0) {
            PASS(slide)(column, f->joint[i].z_joint, felt);
            return;
        }
        PASS(turn)(column, f->joint[i].z_joint, point, f->joint[i].o_joint, felt,
                   arm->joint[i].direction);
        return;
    }
    if (which < 3) {
        PASS(slide)(column, f->axis[which], scale);
        return;
    }
    const double *axis = arm->probe_axis[which - 3];
    lanes lever[3];
    for (int l = 0; l < LANES; ++l) {
        lever[0][l] = axis[1] * turned[2][l] - axis[2] * turned[1][l];
        lever[1][l] = axis[2] * turned[0][l] - axis[0] * turned[2][l];
        lever[2][l] = axis[0] * turned[1][l] - axis[1] * turned[0][l];
    }
    PASS(along)(column, f, lever, scale);
}

/* normal += rows' rows of a block: `width` columns of 3 * LANES numbers, upper triangle.
 * Four columns against four at a time, so that each number loaded is used four times. */
static void PASS(square)(const double *rows, long width, double *normal)
{
    enum { LENGTH = 3 * LANES };
    for (long f = 0; f < width; f += TILE)
        for (long g = f; g < width; g += TILE) {
            vector sum[TILE][TILE];
            memset(sum, 0, sizeof sum);
            const double *left = rows + f * LENGTH, *right = rows + g * LENGTH;
            for (long r = 0; r < LENGTH; r += WIDE) {
                vector a[TILE], b[TILE];
                for (int t = 0; t < TILE; ++t) {
                    a[t] = *(const vector *)(left + t * LENGTH + r);
                    b[t] = *(const vector *)(right + t * LENGTH + r);
                }
                for (int t = 0; t < TILE; ++t)
                    for (int u = 0; u < TILE; ++u)
                        sum[t][u] += a[t] * b[u];
            }
            for (int t = 0; t < TILE; ++t)
                for (int u = 0; u < TILE; ++u) {
                    double total = 0.0;
                    for (int w = 0; w < WIDE; ++w)
                        total += sum[t][u][w];
                    normal[(f + t) * width + g + u] += total;
                }
        }
}

/* a block's postures and its points in the base frame: `scale` is the root of each one's weight,
 * `turned` where it is from the mount, along the flange's axes */
static void PASS(place)(const Arm *arm, const JointTerms *terms, const Poses *poses, long begin,
                        long size, Frames *f, double *scale, lanes *turned, lanes *point)
{
    lanes center[3];
    for (int l = 0; l < LANES; ++l) {
        /* the last block is filled up with its first pose, at no weight */
        const long row = begin + (l < size ? l : 0);
        scale[l] = l < size ? sqrt(poses->weight[row]) : 0.0;
        for (int k = 0; k < 3; ++k)
            center[k][l] = poses->centers[3 * row + k];
        for (int i = 0; i < arm->n; ++i) {
            const long slide = arm->joint[i].slide;
            f->cosine[i][l] = poses->cosine[i * poses->count + row];
            f->sine[i][l] = poses->sine[i * poses->count + row];
            f->slide[i][l] = slide < 0 ? 0.0 : poses->slide[slide * poses->count + row];
            for (long t = 2 * terms->harmonics; t < terms->count; ++t) {
                const long given = (t - 2 * terms->harmonics) * arm->n + i;
                f->basis[t][i][l] = terms->given[given * poses->count + row];
            }
        }
    }
    if (terms->count)
        PASS(joint_errors)(arm, terms, f);
    PASS(frames)(arm, f);
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l)
            turned[k][l] = arm->mount[k][0] * center[0][l] + arm->mount[k][1] * center[1][l]
                           + arm->mount[k][2] * center[2][l];
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < LANES; ++l) {
            const double x = turned[0][l] + arm->place[0], y = turned[1][l] + arm->place[1];
            const double z = turned[2][l] + arm->place[2];
            point[k][l] = f->origin[k][l] + f->axis[0][k][l] * x + f->axis[1][k][l] * y
                          + f->axis[2][k][l] * z;
        }
}

static void PASS(sphere)(const Arm *arm, const JointTerms *terms, const Poses *poses,
                         const Columns *columns, long first, long last, double *rows,
                         SphereOut out)
{
    const long width = columns->padded;
    Frames *f = (Frames *)(rows + width * 3 * LANES);
    for (long begin = first; begin < last; begin += LANES) {
        const long size = last - begin < LANES ? last - begin : LANES;
        lanes scale, turned[3], point[3];
        PASS(place)(arm, terms, poses, begin, size, f, scale, turned, point);
        if (begin == first)
            for (int k = 0; k < 3; ++k)
                out.reference[k] = point[k][0];
        for (long c = 0; c < columns->count; ++c)
            PASS(column)(arm, f, point, turned, columns->which[c], scale,
                         (lanes *)(rows + c * 3 * LANES));
        lanes *deviation = (lanes *)(rows + columns->count * 3 * LANES);
        for (int k = 0; k < 3; ++k)
            for (int l = 0; l < LANES; ++l) {
                const double away = scale[l] * (point[k][l] - out.reference[k]);
                deviation[k][l] = away;
                out.moment[k] += scale[l] * away;
                out.spread[k] += away * away;
            }
        for (int l = 0; l < LANES; ++l)
            *out.weight += scale[l] * scale[l];
        for (long c = 0; c < columns->count; ++c) {
            const lanes *own = (const lanes *)(rows + c * 3 * LANES);
            for (int k = 0; k < 3; ++k) {
                double total = 0.0;
                for (int l = 0; l < LANES; ++l)
                    total += scale[l] * own[k][l];
                out.jacobian[k * columns->count + c] += total;
            }
        }
        PASS(square)(rows, width, out.normal);
    }
}
