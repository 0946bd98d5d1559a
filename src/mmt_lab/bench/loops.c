/* The loops of mmt.texture in C, to say what numba's strict form costs.
   Same algorithms and the same order of operations as burg.py, lsf.py and synthesis.py. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#define LARGEST_ORDER 64
#define LANES 4

/* mmt.texture.autoregression.burg._sums, in lanes, which is what suits this compiler best */
static void add_squares(const double *f, const double *b, int64_t count, double *sums,
                        double *differences)
{
    double s[LANES] = {0}, d[LANES] = {0};
    int64_t i = 0;
    for (; i + LANES <= count; i += LANES)
        for (int lane = 0; lane < LANES; lane++) {
            const double sum = f[i + lane] + b[i + lane], difference = f[i + lane] - b[i + lane];
            s[lane] += sum * sum;
            d[lane] += difference * difference;
        }
    for (; i < count; i++) {
        s[0] += (f[i] + b[i]) * (f[i] + b[i]);
        d[0] += (f[i] - b[i]) * (f[i] - b[i]);
    }
    *sums = *differences = 0.0;
    for (int lane = 0; lane < LANES; lane++) {
        *sums += s[lane];
        *differences += d[lane];
    }
}

/* mmt.texture.autoregression.burg_recursion.burg_into */
static void burg(const double *x, int64_t n, int64_t m, double *reflection, double *variances,
                 double *work)
{
    double *forward = work, *backward = work + n;
    double largest = 0.0;
    for (int64_t i = 0; i < n; i++) largest = fmax(largest, fabs(x[i]));
    int exponent;
    frexp(largest, &exponent);
    const int half = exponent / 2;
    const double first = ldexp(1.0, -half), second = ldexp(1.0, half - exponent);
    for (int64_t i = 0; i < n; i++) forward[i] = backward[i] = x[i] * first * second;
    double variance, nothing;
    add_squares(forward, backward, n, &variance, &nothing);
    variance *= 0.25 / (double)n;
    const double vanished = ldexp(variance, -100);
    variances[0] = ldexp(variance, 2 * exponent);
    memset(reflection, 0, (size_t)m * sizeof(double));
    for (int64_t order = 1; order <= m; order++) {
        variances[order] = variances[order - 1];
        if (variance <= vanished) continue;
        double *f = forward + order, *b = backward;
        const int64_t count = n - order;
        double sums, differences;
        add_squares(f, b, count, &sums, &differences);
        const double total = sums + differences;
        if (total == 0.0) {
            variance = 0.0;
            continue;
        }
        const double plus = 2.0 * (differences / total), minus = 2.0 * (sums / total);
        reflection[order - 1] = (differences - sums) / total;
        variance *= fmin(1.0, plus * minus);
        variances[order] = ldexp(variance, 2 * exponent);
        if (plus < minus) {
            for (int64_t i = 0; i < count; i++) {
                const double left = f[i], right = b[i];
                f[i] = (left - right) + plus * right;
                b[i] = (right - left) + plus * left;
            }
        } else {
            for (int64_t i = 0; i < count; i++) {
                const double left = f[i], right = b[i];
                f[i] = (left + right) - minus * right;
                b[i] = (right + left) - minus * left;
            }
        }
    }
}

void burg_each(const double *joined, const int64_t *stops, int64_t segments, int64_t m,
               double *reflection, double *variances, double *work)
{
    int64_t start = 0;
    for (int64_t row = 0; row < segments; row++) {
        burg(joined + start, stops[row] - start, m, reflection + row * m,
             variances + row * (m + 1), work);
        start = stops[row];
    }
}

/* mmt.texture.autoregression.lsf._half_product, but for the order of the factors: here they ascend */
static void half_product(const double *lsf, int first, int count, double *half)
{
    half[0] = 1.0;
    for (int done = 0; done < count; done++) {
        const double middle = -2.0 * cos(lsf[first + 2 * done]);
        const double beyond = done > 0 ? half[done - 1] : 0.0;
        half[done + 1] = beyond + middle * half[done] + beyond;
        for (int j = done; j > 1; j--) half[j] += middle * half[j - 1] + half[j - 2];
        if (done > 0) half[1] += middle;
    }
}

/* mmt.texture.autoregression.lsf.lsf_to_ar_into */
static void lsf_to_ar(const double *lsf, int order, double *ar)
{
    const int p_count = (order + 1) / 2, q_count = order / 2;
    double p[LARGEST_ORDER / 2 + 1], q[LARGEST_ORDER / 2 + 1];
    half_product(lsf, 0, p_count, p);
    half_product(lsf, 1, q_count, q);
    if (order % 2 == 0) {
        for (int j = 1; j <= p_count; j++) {
            const double left = p[j] + p[j - 1], right = q[j] - q[j - 1];
            ar[j - 1] = 0.5 * (left + right);
            ar[order - j] = 0.5 * (left - right);
        }
        return;
    }
    for (int j = 1; j < p_count; j++) {
        const double right = q[j] - (j > 1 ? q[j - 2] : 0.0);
        ar[j - 1] = 0.5 * (p[j] + right);
        ar[order - j] = 0.5 * (p[j] - right);
    }
    ar[p_count - 1] = 0.5 * p[p_count];
}

void lsf_to_ar_each(const double *lsf, int64_t filters, int64_t order, double *ar)
{
    for (int64_t row = 0; row < filters; row++)
        lsf_to_ar(lsf + row * order, (int)order, ar + row * order);
}

/* mmt.texture.autoregression.lsf.ar_to_reflection_into; 0 where it is not stable */
static int ar_to_reflection(const double *ar, int order, double *reflection)
{
    memcpy(reflection, ar, (size_t)order * sizeof(double));
    for (int stage = order - 1; stage >= 0; stage--) {
        const double k = reflection[stage], complement = (1.0 - k) * (1.0 + k);
        if (!(complement > 0.0)) return 0;
        const double scale = 1.0 / complement;
        for (int j = 0; j < stage / 2; j++) {
            const double left = reflection[j], right = reflection[stage - 1 - j];
            reflection[j] = (left - k * right) * scale;
            reflection[stage - 1 - j] = (right - k * left) * scale;
        }
        if (stage % 2 == 1) reflection[stage / 2] /= 1.0 + k;
    }
    return 1;
}

static int barycentric(const double *vertices, int64_t columns, const int64_t *triangle, double x,
                       double y, double *weights)
{
    const double *a = vertices + triangle[0] * columns, *b = vertices + triangle[1] * columns;
    const double *c = vertices + triangle[2] * columns;
    const double bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
    const double area = bx * cy - by * cx;
    if (fabs(area) <= 1e-15) return 0;
    const double px = x - a[0], py = y - a[1];
    weights[1] = (px * cy - py * cx) / area;
    weights[2] = (bx * py - by * px) / area;
    weights[0] = 1.0 - weights[1] - weights[2];
    return 1;
}

/* mmt.texture.interpolation.delaunay.locate without its last resort, a scan; -1 where it would be needed */
static int64_t locate(const double *vertices, int64_t columns, const int64_t *triangles,
                      int64_t count, int64_t start, double x, double y, double *weights)
{
    int64_t at = start;
    for (int64_t step = 0; step <= count; step++) {
        if (!barycentric(vertices, columns, triangles + 6 * at, x, y, weights)) return -1;
        int least = 0;
        if (weights[1] < weights[least]) least = 1;
        if (weights[2] < weights[least]) least = 2;
        if (weights[least] >= -1e-12) {
            double total = 0.0;
            for (int i = 0; i < 3; i++) total += weights[i] = fmax(weights[i], 0.0);
            for (int i = 0; i < 3; i++) weights[i] /= total;
            return at;
        }
        at = triangles[6 * at + 3 + least];
        if (at < 0) return -1;
    }
    return -1;
}

/* mmt.texture.synthesis.synthesizer._render for a variance that is linear in a triangle, by way of the filter's
   coefficients alone; -1 where that is not enough. memory holds the lattice's first state. */
int64_t render(const double *vertices, int64_t columns, const int64_t *triangles,
               int64_t triangle_count, const double *speed_mm_s, const double *force_n,
               double per_speed, double per_force, int64_t renewal, double limit, double release,
               const double *noise, int64_t samples, double *memory, double *output)
{
    const int order = (int)(columns - 3);
    double lsf[LARGEST_ORDER], ar[LARGEST_ORDER], k[LARGEST_ORDER], c[LARGEST_ORDER], weights[3];
    double wanted = 0.0, amplitude = 0.0;
    int64_t triangle = 0;
    for (int64_t index = 0; index < samples; index++) {
        if (index % renewal == 0) {
            const double x = fmin(fmax(speed_mm_s[index] * per_speed, 0.0), 1.0);
            const double y = fmin(fmax(force_n[index] * per_force, 0.0), 1.0);
            triangle =
                locate(vertices, columns, triangles, triangle_count, triangle, x, y, weights);
            if (triangle < 0) return -1;
            double level = 0.0;
            memset(lsf, 0, sizeof lsf);
            for (int corner = 0; corner < 3; corner++) {
                const double *vertex = vertices + triangles[6 * triangle + corner] * columns;
                level += weights[corner] * vertex[2];
                for (int i = 0; i < order; i++) lsf[i] += weights[corner] * vertex[3 + i];
            }
            lsf_to_ar(lsf, order, ar);
            if (!ar_to_reflection(ar, order, k)) return -1;
            for (int i = 0; i < order; i++) c[i] = sqrt((1.0 - k[i]) * (1.0 + k[i]));
            wanted = sqrt(level);
            for (int i = 0; i < order; i++) wanted /= c[i];
        }
        double before = memory[order - 1];
        double forward = c[order - 1] * noise[index] - k[order - 1] * before;
        for (int j = order - 2; j >= 0; j--) {
            before = memory[j];
            memory[j + 1] = k[j] * forward + c[j] * before;
            forward = c[j] * forward - k[j] * before;
        }
        memory[0] = forward;
        amplitude *= release;
        if (amplitude < 1e-9) amplitude = 0.0;
        amplitude = fmax(amplitude, wanted);
        output[index] = fmin(fmax(amplitude * forward, -limit), limit);
    }
    return 0;
}
