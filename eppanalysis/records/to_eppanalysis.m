function to_eppanalysis(file, x)
% TO_EPPANALYSIS  Write a timetable, tf, ss or frd as plain numbers that eppanalysis reads.
%   to_eppanalysis('flight.mat', T)      timetable T: diagnose, identify, run.input.file
%   to_eppanalysis('plant.mat', G)       tf, zpk, ss: epp.read_linear;  frd: epp.read_response
if istimetable(x)
    s = struct('kind', 'timetable', 'values', x{:, :});
    s.time = seconds(x.Properties.RowTimes - x.Properties.RowTimes(1));
    s.names = x.Properties.VariableNames;
    s.units = x.Properties.VariableUnits;       % {} where there are none: SI
else
    x = chgTimeUnit(x, 'seconds');
    if isa(x, 'frd')                            % frequencies in rad/s; outputs by inputs by frequencies
        x = chgFreqUnit(x, 'rad/s');
        s = struct('kind', 'frd', 'frequency', x.Frequency, 'response', x.ResponseData);
    elseif hasdelay(x)
        error('A dead time is a block of its own: remove it, and give it to the block as its delay.')
    elseif issiso(x) && ~isa(x, 'ss')
        s = struct('kind', 'tf', 'sample_time', x.Ts);
        [s.num, s.den] = tfdata(x, 'v');
    else
        s = struct('kind', 'ss', 'sample_time', x.Ts);
        [s.A, s.B, s.C, s.D] = ssdata(x);
        s.input_names = x.InputName; s.output_names = x.OutputName;
    end
end
eppanalysis = s;
save(file, 'eppanalysis', '-v7')                % '-v7.3' from 2 GB on
end
