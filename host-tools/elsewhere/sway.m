% Sway in MATLAB or Octave: a trial from above and over time, and a figure compared between two
% conditions.
%
%     plumb export trials/p01-foam --format parquet --out p01-foam.parquet
%     plumb figures trials/* --out figures.parquet
%     matlab -batch "sway('p01-foam.parquet', 'figures.parquet', 'sway.png')"
%
% Octave reads no Parquet: there, files that end with .csv. MATLAB reads both.
function sway(trial_file, figures_file, picture)
  trial = read_columns(trial_file);
  figures = read_columns(figures_file);
  fprintf('%d frames, %d without the lower trunk\n', numel(trial.time_s), sum(isnan(trial.lower_ap_mm)));

  %% A figure in two conditions
  % The table is tidy: one row for each trial, trunk, segment, direction and figure.
  is_it = strcmp(figures.figure, 'path length') & strcmp(figures.segment, 'T1') ...
    & strcmp(figures.direction, 'APML') & strcmp(figures.trunk, 'upper');
  conditions = unique(figures.condition(is_it), 'stable');
  participants = unique(figures.participant(is_it), 'stable');
  % A row for each participant, a column for each condition; NaN where a value is missing.
  wide = nan(numel(participants), 2);
  for row = 1:numel(participants)
    for column = 1:2
      own = is_it & strcmp(figures.participant, participants(row)) ...
        & strcmp(figures.condition, conditions(column));
      wide(row, column) = mean(figures.value(own));
    end
  end
  both = wide(~any(isnan(wide), 2), :);
  for column = 1:2
    fprintf('%s: %.12g mm\n', char(conditions(column)), mean(both(:, column)));
  end
  % A paired t test, as ttest of the Statistics Toolbox makes it.
  difference = both(:, 2) - both(:, 1);
  df = numel(difference) - 1;
  t = mean(difference) / (std(difference) / sqrt(df + 1));
  p = betainc(df / (df + t^2), df / 2, 1 / 2);
  fprintf('t(%d) = %.12g, p = %.12g\n', df, t, p);

  %% The picture
  window = figure('visible', 'off', 'position', [0, 0, 1440, 480]);
  % t = 0 is the mark; NaN leaves a gap in the line.
  stands = trial.time_s >= 0;
  ap_mm = middle(trial.lower_ap_mm(stands));
  ml_mm = middle(trial.lower_ml_mm(stands));
  subplot(1, 3, 1);
  plot(ml_mm, ap_mm);
  axis equal;
  title('lower trunk, from above');
  xlabel('ML, to the right (mm)');
  ylabel('AP, forward (mm)');
  subplot(1, 3, 2);
  plot(trial.time_s(stands), ap_mm);
  title('lower trunk over time');
  xlabel('time (s)');
  ylabel('AP, forward (mm)');
  subplot(1, 3, 3);
  plot([1, 2], both', 'o-');
  axis([0.7, 2.3, 0, 1.05 * max(both(:))]);
  set(gca, 'xtick', [1, 2], 'xticklabel', cellstr(conditions(1:2)));
  title('upper trunk, each participant');
  ylabel('path length, AP and ML, T1 (mm)');
  print(window, picture, '-dpng', '-r100');
  close(window);
end

function values = middle(values)
  values = values - mean(values(~isnan(values)));
end

% The columns of a table: vectors of numbers, NaN where one is missing, and lists of texts.
function columns = read_columns(path)
  if ~exist('OCTAVE_VERSION', 'builtin')
    if strcmp(path(max(1, end - 7):end), '.parquet')
      columns = table2struct(parquetread(path), 'ToScalar', true);
    else
      columns = table2struct(readtable(path, 'TextType', 'string'), 'ToScalar', true);
    end
    return;
  end
  lines = strsplit(strtrim(fileread(path)), "\n");
  % A cell with a comma in it is in quotes.
  cells = regexp(strcat(lines, ','), '("[^"]*"|[^,]*),', 'tokens');
  names = [cells{1}{:}];
  rows = [cells{2:end}];
  rows = reshape([rows{:}], numel(names), [])';
  for column = 1:numel(names)
    texts = rows(:, column);
    numbers = str2double(texts);
    is_text = isnan(numbers) & ~strcmp(texts, '') & ~strcmpi(texts, 'nan');
    if any(is_text) || all(strcmp(texts, ''))
      columns.(names{column}) = strrep(texts, '"', '');
    else
      columns.(names{column}) = numbers;
    end
  end
end
