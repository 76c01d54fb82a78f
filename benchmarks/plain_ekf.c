/* The extended Kalman filter of a textbook, two RC pairs, nothing added: see plain_ekf.py. */
#include <math.h>
#include <stdint.h>

#define POINTS 1001 /* of the tables over SOC */
#define COLUMNS 6   /* OCV, its slope, R0, overpotential, R1, R2 */
#define STATES 3

static double clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* Circuit at a SOC and temperature, linear between the points of the tables and held at their ends. */
static void look_up(const double *table, int n_degc, const double *grid, double soc, double degc, double *p)
{
    const double place = clip(soc, 0, 1) * (POINTS - 1);
    const int j = place < POINTS - 2 ? (int)place : POINTS - 2;
    int row = 0;
    while (row < n_degc - 2 && degc >= grid[row + 1]) row++;
    const double share = n_degc > 1 ? clip((degc - grid[row]) / (grid[row + 1] - grid[row]), 0, 1) : 0;
    const double *cold = table + (row * POINTS + j) * COLUMNS, *warm = n_degc > 1 ? cold + POINTS * COLUMNS : cold;
    for (int q = 0; q < COLUMNS; q++) {
        const double below = cold[q] + share * (warm[q] - cold[q]);
        p[q] = below + (place - j) * (cold[q + COLUMNS] + share * (warm[q + COLUMNS] - cold[q + COLUMNS]) - below);
    }
}

/* `noise` is the variance of voltage, current and SOC walk; `x` begins with the SOC. Arrays are (n_steps, n). */
void plain_ekf(int64_t n_steps, int32_t n, const double *dt_s, const double *current_a, const double *voltage_v,
               const double *degc, const double *table, int32_t n_degc, const double *grid, const double *tau_s,
               double capacity_ah, double overpotential_a, const double *noise, double soc_sigma, const double *soc_0,
               double *soc, double *sigma)
{
    for (int c = 0; c < n; c++) {
        double x[STATES] = {soc_0[c]}, P[STATES][STATES] = {{soc_sigma * soc_sigma}};
        for (int64_t k = 0; k < n_steps; k++) {
            const int64_t at = k * n + c;
            const double i = current_a[at], A[STATES] = {1, exp(-dt_s[k] / tau_s[0]), exp(-dt_s[k] / tau_s[1])};
            const double B[STATES] = {-dt_s[k] / (3600 * capacity_ah), 1 - A[1], 1 - A[2]};
            double p[COLUMNS], PH[STATES] = {0}, S = noise[0];
            for (int u = 0; u < STATES; u++) {
                x[u] = A[u] * x[u] + B[u] * i;
                for (int w = 0; w < STATES; w++) P[u][w] = A[u] * P[u][w] * A[w] + B[u] * B[w] * noise[1];
            }
            P[0][0] += noise[2] * dt_s[k];
            look_up(table, n_degc, grid, x[0], degc[at], p);
            const double H[STATES] = {p[1], -p[4], -p[5]};
            const double ocv_v = p[0] + p[1] * (x[0] - clip(x[0], 0, 1));
            const double predicted_v = ocv_v - p[2] * i - p[3] * asinh(i / overpotential_a) - p[4] * x[1] - p[5] * x[2];
            for (int u = 0; u < STATES; u++) {
                for (int w = 0; w < STATES; w++) PH[u] += P[u][w] * H[w];
                S += H[u] * PH[u];
            }
            if (!isnan(voltage_v[at]))
                for (int u = 0; u < STATES; u++) {
                    x[u] += PH[u] / S * (voltage_v[at] - predicted_v);
                    for (int w = 0; w < STATES; w++) P[u][w] -= PH[u] * PH[w] / S;
                }
            x[0] = clip(x[0], -0.05, 1.05);
            soc[at] = clip(x[0], 0, 1);
            sigma[at] = sqrt(P[0][0]);
        }
    }
}
