# Sway in R: a trial from above and over time, and a figure compared between two conditions.
#
#     plumb export trials/p01-foam --format parquet --out p01-foam.parquet
#     plumb figures trials/* --out figures.parquet
#     Rscript sway.R p01-foam.parquet figures.parquet sway.png
#
# Files that end with .csv do as well.

## The files ---------------------------------------------------------------------------------------
# Parquet is read by arrow or nanoparquet (install.packages), or else through Python's pyarrow.
read_table <- function(path) {
  if (!grepl("\\.parquet$", path)) return(read.csv(path, encoding = "UTF-8"))
  if (requireNamespace("arrow", quietly = TRUE)) return(as.data.frame(arrow::read_parquet(path)))
  if (requireNamespace("nanoparquet", quietly = TRUE)) return(nanoparquet::read_parquet(path))
  table <- reticulate::import("pyarrow.parquet")$read_table(path)
  column <- function(name) {
    values <- table$column(name)$to_pylist()
    if (is.list(values)) values <- sapply(values, function(it) if (is.null(it)) NA else it)
    values
  }
  as.data.frame(sapply(table$column_names, column, simplify = FALSE))
}

arguments <- commandArgs(trailingOnly = TRUE)
if (length(arguments) != 3) arguments <- c("p01-foam.parquet", "figures.parquet", "sway.png")
trial <- read_table(arguments[1])
figures <- read_table(arguments[2])
cat(sprintf("%d frames, %d without the lower trunk\n", nrow(trial), sum(is.na(trial$lower_ap_mm))))

## A figure in two conditions ----------------------------------------------------------------------
# The table is tidy: one row for each trial, trunk, segment, direction and figure.
paths <- subset(figures, figure == "path length" & segment == "T1" & direction == "APML" & trunk == "upper")
conditions <- unique(paths$condition)[1:2]
# A row for each participant, a column for each condition; NA where a value is missing.
wide <- tapply(paths$value, paths[c("participant", "condition")], mean)[, conditions]
both <- wide[complete.cases(wide), , drop = FALSE]
test <- t.test(both[, 2], both[, 1], paired = TRUE)
cat(sprintf("%s: %.12g mm\n", conditions, colMeans(both)), sep = "")
cat(sprintf("t(%d) = %.12g, p = %.12g\n", test$parameter, test$statistic, test$p.value))

## The picture -------------------------------------------------------------------------------------
png(arguments[3], width = 1440, height = 480, res = 120, type = "cairo")
par(mfrow = c(1, 3), mar = c(4.2, 4.2, 2.5, 1))
# t = 0 is the mark; NA leaves a gap in the line.
stands <- subset(trial, time_s >= 0)
middle <- function(values) values - mean(values, na.rm = TRUE)
plot(middle(stands$lower_ml_mm), middle(stands$lower_ap_mm), type = "l", asp = 1, col = "steelblue",
     main = "lower trunk, from above", xlab = "ML, to the right (mm)", ylab = "AP, forward (mm)")
plot(stands$time_s, middle(stands$lower_ap_mm), type = "l", col = "steelblue",
     main = "lower trunk over time", xlab = "time (s)", ylab = "AP, forward (mm)")
matplot(t(both), type = "b", pch = 19, lty = 1, xaxt = "n", xlim = c(0.7, 2.3), ylim = c(0, max(both)),
        main = "upper trunk, each participant", xlab = "", ylab = "path length, AP and ML, T1 (mm)")
axis(1, at = 1:2, labels = conditions)
invisible(dev.off())
